# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene of the benchmark: a rippled ring on a floor under a square lamp, with any number of triangles."""
from __future__ import annotations

from math import pi, radians

import numpy as np

FLOOR, LAMP = 8, 2                  # quads along a side of the floor; triangles of the lamp
LEAST = 2 * FLOOR * FLOOR + LAMP + 2 * 8 * 8
RADIANCE, FIELD_OF_VIEW = 12.0, 40.0  # W/(m^2 sr); degrees
COLORS = {"Ring": (0.75, 0.3, 0.15), "Floor": (0.6, 0.6, 0.6), "Lamp": (0.0, 0.0, 0.0)}


def make_meshes(triangles: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Object name -> vertices (n, 3) f32 in metres, quads (m, 4); at most `triangles` triangles, and hardly fewer.

    Raises ValueError for fewer than LEAST.
    """
    if triangles < LEAST:
        raise ValueError(f"the benchmark's scene needs at least {LEAST} triangles, not {triangles}")
    quads = (triangles - LAMP) // 2 - FLOOR * FLOOR
    side = quads ** 0.5
    around = min(range(int(side), int(2 * side)), key=lambda around: quads % around)  # the fewest quads are left over
    return {"Ring": _make_ring(around, quads // around), "Floor": _make_grid(FLOOR, 1.2, -0.2),
            "Lamp": _make_grid(1, 0.4, 1.2, down=True)}


def triangle_corners(triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """All triangles (N, 3, 3) f32, the lamp's last, and whether each is the lamp's (N,) bool."""
    halves = [[0, 1, 2], [0, 2, 3]]
    parts = [vertices[quads[:, halves].reshape(-1, 3)] for vertices, quads in make_meshes(triangles).values()]
    lamp = np.repeat([False, False, True], [len(part) for part in parts])
    return np.concatenate(parts).astype(np.float32), lamp


def camera_to_world() -> np.ndarray:
    """(4, 4) f32: above and in front, looking at the origin."""
    position = np.array((0.0, -1.5, 0.9))
    back = position / np.linalg.norm(position)
    right = np.array((1.0, 0.0, 0.0))
    matrix = np.eye(4, dtype=np.float32)
    matrix[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return matrix


def build(triangles: int, resolution: int) -> None:
    """Replace the open file by the scene, without a world."""
    import bpy

    from mathutils import Matrix
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for name, (vertices, quads) in make_meshes(triangles).items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(vertices.tolist(), [], quads.tolist())
        mesh.materials.append(_make_material(bpy, name))
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.angle, camera.matrix_world = radians(FIELD_OF_VIEW), Matrix(camera_to_world().tolist())
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = resolution
    scene.render.resolution_percentage = 100


def _make_material(bpy, name: str):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*COLORS[name], 1)
    if name == "Lamp":
        inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (1, 1, 1, 1), RADIANCE
    return material


def _make_ring(around: int, across: int) -> tuple[np.ndarray, np.ndarray]:
    u, v = (g.ravel() for g in np.meshgrid(np.arange(around) * 2 * pi / around, np.arange(across) * 2 * pi / across,
                                           indexing="ij"))
    tube = 0.15 * (1 + 0.2 * np.sin(9 * u) * np.sin(3 * v))
    out = 0.35 + tube * np.cos(v)
    vertices = np.stack([out * np.cos(u), out * np.sin(u), tube * np.sin(v)], axis=1)
    i, j = (g.ravel() for g in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    corner = lambda di, dj: (i + di) % around * across + (j + dj) % across  # noqa: E731
    return vertices, np.stack([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)], axis=1)


def _make_grid(side: int, size: float, height: float, down: bool = False) -> tuple[np.ndarray, np.ndarray]:
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(-size / 2, size / 2, side + 1)] * 2, indexing="ij"))
    i, j = (g.ravel() for g in np.meshgrid(*[np.arange(side)] * 2, indexing="ij"))
    first, line = i * (side + 1) + j, side + 1
    quads = np.stack([first, first + line, first + line + 1, first + 1], axis=1)
    return np.stack([x, y, np.full_like(x, height)], axis=1), quads[:, ::-1] if down else quads
