# SPDX-License-Identifier: GPL-3.0-or-later
"""1 to 8 lights: emissive triangles and meshes, AREA, POINT, SPOT and SUN lamps.

Powers follow from the irradiance that each light shall bring to the scene's centre, by the radiometry of
docs/scene-input.md 6.4, so that pictures are well exposed whatever the kind, size and distance.
"""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from .materials import emissive_material
from .templates import Room

KINDS = ("triangle", "mesh", "AREA", "POINT", "SPOT", "SUN")
OUTSIDE = (0.3, 0.06, 0.24, 0.16, 0.12, 0.12)  # chance of each kind
INSIDE = (0.2, 0.1, 0.4, 0.25, 0.05, 0.0)      # below a ceiling


def build_lights(rng: np.random.Generator, room: Room, count: int, irradiance: float, kind: str | None = None) -> None:
    """`count` lights that share `irradiance` W/m^2 (facing surface at the origin, no shadows).

    kind: one of KINDS, or any of them by chance.
    """
    shares = rng.dirichlet(np.full(count, 2.0)) * irradiance
    for i, share in enumerate(shares):
        chosen = kind or str(rng.choice(KINDS, p=INSIDE if room.enclosed else OUTSIDE))
        position, target = light_position(rng, room), rng.uniform(-0.2, 0.2, 3)
        if chosen in ("triangle", "mesh"):
            light = emitter(rng, f"light {i}", chosen, room, position, share)
        else:
            light = lamp(rng, f"light {i}", chosen, room, np.linalg.norm(position - target), share)
            light.rotation_euler = Vector(target - position).to_track_quat("-Z", "Y").to_euler()
        light.location = position
        light.visible_camera = bool(rng.uniform() < 0.3)
        bpy.context.scene.collection.objects.link(light)


def light_position(rng: np.random.Generator, room: Room) -> np.ndarray:
    """Above the floor and on the open side of the walls; under the ceiling of a box."""
    if room.enclosed:
        reach = 0.8 * room.half
        return np.array([*rng.uniform(-reach, reach, 2), room.floor + room.height * rng.uniform(0.75, 0.95)])
    azimuth = rng.uniform(-1, 1) * min(np.pi, room.spread + 0.4) - np.pi / 2
    elevation = np.arcsin(rng.uniform(0.2, 1.0))
    distance = rng.uniform(1.3, 2.7)
    flat = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(elevation)
    return distance * np.array([*flat, np.sin(elevation)])


def light_color(rng: np.random.Generator) -> np.ndarray:
    """(3,) with mean 1: white, warm or cold mostly, sometimes any colour."""
    color = rng.uniform(0.05, 1.0, 3) if rng.uniform() < 0.25 else 1.0 + np.array([1, 0, -1]) * rng.normal(0, 0.2)
    return np.maximum(color, 0.02) / np.maximum(color, 0.02).mean()


def lamp(rng: np.random.Generator, name: str, kind: str, room: Room, distance: float, share: float) -> bpy.types.Object:
    data = bpy.data.lights.new(name, kind)
    data.color = light_color(rng)
    if kind == "AREA":
        data.shape = str(rng.choice(["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"]))
        data.size, data.size_y = rng.uniform(0.1, 0.4 if room.enclosed else 1.2, 2)
        data.energy = share * np.pi * distance**2
    elif kind == "SUN":
        data.angle, data.energy = np.radians(rng.uniform(0.5, 15)), share
    else:
        data.shadow_soft_size = rng.uniform(0.01, 0.05 if room.enclosed else 0.2)
        data.energy = share * 4 * np.pi * distance**2
    if kind == "SPOT":
        data.spot_size, data.spot_blend = np.radians(rng.uniform(25, 90)), rng.uniform(0, 1)
    return bpy.data.objects.new(name, data)


def emitter(rng: np.random.Generator, name: str, kind: str, room: Room, position: np.ndarray,
            share: float) -> bpy.types.Object:
    """The paper's equilateral triangle, or a small glowing polyhedron; radiance = intensity / projected area."""
    shrink = 0.6 if room.enclosed else 1.0
    if kind == "triangle":
        points = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]]) * 0.025 * rng.uniform(2.0, 2.5) * shrink
        faces = [(0, 1, 2)]
    else:
        points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        points = points * rng.uniform(0.03, 0.1) * shrink
        faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    points = points - points.mean(axis=0)
    area = sum(np.linalg.norm(np.cross(points[b] - points[a], points[c] - points[a])) / 2 for a, b, c in faces)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    strength = radiance(share, position, area, closed=kind == "mesh")
    mesh.materials.append(emissive_material(light_color(rng), strength))
    light = bpy.data.objects.new(name, mesh)
    light.rotation_euler = rng.uniform(-np.pi, np.pi, 3)
    return light


def radiance(share: float, position: np.ndarray, area: float, *, closed: bool) -> float:
    """W/(m^2 sr) of both sides of a surface that brings the irradiance `share` to the origin, whatever way it turns."""
    projected = area / 4 if closed else area / 2  # mean over directions
    return share * max(np.linalg.norm(position), 0.3) ** 2 / projected
