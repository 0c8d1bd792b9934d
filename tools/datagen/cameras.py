# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras outside or inside the room, kept only when they see something (docs/scene-input.md 1.2)."""
from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from mathutils import Matrix, Vector

from .templates import Room

GRID = 12             # rays per side of the test picture
TRIES = 40
LEAST_COVERED = 0.45  # of the picture
LEAST_OBJECTS = 0.07
NEAREST = 0.12


class Setup(NamedTuple):
    """The cameras of the open file, and how they are to be rendered."""

    cameras: list[bpy.types.Object]
    token_budget: int = 3072  # most triangles of the RenderScene
    resolution: int = 128     # pixels, both sides


def build_cameras(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras, or None when the room has no good view. The depsgraph must be up to date."""
    inside = room.kind == "closed_box" or (room.kind != "floor" and rng.uniform() < 0.2)
    cameras = []
    for i in range(count):
        for _ in range(TRIES):
            pose = inside_pose(rng, room) if inside else outside_pose(rng, room)
            fov = rng.uniform(np.radians(45 if inside else 30), np.radians(60))
            if sees_enough(pose, fov):
                break
        else:
            return None
        cameras.append(add_camera(f"camera {i}", pose, fov))
    return cameras


def add_camera(name: str, pose: Matrix, fov: float) -> bpy.types.Object:
    data = bpy.data.cameras.new(name)
    data.angle, data.clip_start = fov, 0.001
    camera = bpy.data.objects.new(name, data)
    camera.matrix_world = pose
    bpy.context.scene.collection.objects.link(camera)
    return camera


def outside_pose(rng: np.random.Generator, room: Room) -> Matrix:
    azimuth = -np.pi / 2 + rng.uniform(-room.spread, room.spread)
    elevation = np.radians(rng.uniform(0, 25) if room.enclosed else rng.uniform(5, 60))
    target = rng.uniform(-0.2, 0.2, 3)
    distance = rng.uniform(1.5, 2.0)
    direction = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return look_at(rng, target + distance * direction, target)


def inside_pose(rng: np.random.Generator, room: Room) -> Matrix:
    azimuth = rng.uniform(-np.pi, np.pi)
    reach = 0.93 * min(room.half, 0.75)
    flat = np.array([np.cos(azimuth), np.sin(azimuth)])
    flat *= reach / np.abs(flat).max() * rng.uniform(0.85, 1.0)
    position = np.array([*flat, room.floor + min(room.height, 1.0) * rng.uniform(0.2, 0.9)])
    target = np.array([*rng.uniform(-0.25, 0.25, 2), room.floor + rng.uniform(0.1, 0.5)])
    return look_at(rng, position, target)


def look_at(rng: np.random.Generator, position: np.ndarray, target: np.ndarray) -> Matrix:
    """Camera-to-world whose up is +Z with the paper's jitter."""
    back = position - target
    back /= np.linalg.norm(back)
    right = np.cross(np.array([0, 0, 1]) + rng.uniform(-0.1, 0.1, 3), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return Matrix(pose.tolist())


def sees_enough(pose: Matrix, fov: float, least_covered: float = LEAST_COVERED) -> bool:
    """Casts GRID x GRID rays: enough must hit something, some of them an object, none of them something very near."""
    scene, depsgraph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    eye, turn, reach = pose.translation, pose.to_3x3(), np.tan(fov / 2)
    covered = objects = 0
    for y in np.linspace(-reach, reach, GRID):
        for x in np.linspace(-reach, reach, GRID):
            hit, place, _, _, what, _ = scene.ray_cast(depsgraph, eye, turn @ Vector((x, y, -1.0)).normalized())
            if hit and (place - eye).length < NEAREST:
                return False
            covered += hit
            objects += hit and what.name.startswith("object")
    return covered >= least_covered * GRID**2 and objects >= LEAST_OBJECTS * GRID**2
