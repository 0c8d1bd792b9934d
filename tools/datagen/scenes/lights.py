# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights: emissive triangles and meshes, AREA, POINT, SPOT and SUN lamps, glowing panels, and screens with a picture.

Powers follow from the irradiance that a light shall bring to the scene's centre, by the radiometry of
docs/scene-input.md 6.4, so that pictures are well exposed whatever the kind, size and distance.
"""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from .cameras import spherical_direction
from .materials import emissive_material, link_image, principled, random_color
from .meshes import add_object, make_box, set_box_uv
from .rooms import Room
from .textures import blend_colors, make_image, make_pattern

KINDS = ("triangle", "mesh", "AREA", "POINT", "SPOT", "SUN")
OUTSIDE = (0.3, 0.06, 0.24, 0.16, 0.12, 0.12)  # chance of each kind
INSIDE = (0.2, 0.1, 0.4, 0.25, 0.05, 0.0)      # below a ceiling
LIGHT_VISIBLE, PANEL_VISIBLE = 0.3, 0.7        # chance that the camera sees it
PANEL_THICKNESS = 0.025                        # of the width
SCREEN = 0.4                                   # chance that a panel shows a picture


def build_lights(rng: np.random.Generator, room: Room, count: int, irradiance: float, kind: str | None = None) -> None:
    """`count` lights that share `irradiance` W/m^2 (facing surface at the origin, no shadows).

    kind: one of KINDS, or any of them by chance.
    """
    shares = rng.dirichlet(np.full(count, 2.0)) * irradiance
    for i, share in enumerate(shares):
        own_kind = kind or str(rng.choice(KINDS, p=INSIDE if room.has_ceiling else OUTSIDE))
        position, target = random_position(rng, room), rng.uniform(-0.2, 0.2, 3)
        if own_kind in ("triangle", "mesh"):
            light = add_emitter(rng, f"light {i}", own_kind, room, position, share)
        else:
            light = add_lamp(rng, f"light {i}", own_kind, room, np.linalg.norm(position - target), share)
            light.rotation_euler = Vector(target - position).to_track_quat("-Z", "Y").to_euler()
        light.location = position
        light.visible_camera = bool(rng.uniform() < LIGHT_VISIBLE)


def random_position(rng: np.random.Generator, room: Room) -> np.ndarray:
    """Above the floor and on the open side of the walls; under the ceiling of a box."""
    if room.has_ceiling:
        reach = 0.8 * room.half
        return np.array([*rng.uniform(-reach, reach, 2), room.floor + room.height * rng.uniform(0.75, 0.95)])
    azimuth = rng.uniform(-1, 1) * min(np.pi, room.spread + 0.4) - np.pi / 2
    elevation = np.arcsin(rng.uniform(0.2, 1.0))
    return rng.uniform(1.3, 2.7) * spherical_direction(azimuth, elevation)


def random_light_color(rng: np.random.Generator) -> np.ndarray:
    """(3,) with mean 1: white, warm or cold mostly, sometimes any colour."""
    color = rng.uniform(0.05, 1.0, 3) if rng.uniform() < 0.25 else 1.0 + np.array([1, 0, -1]) * rng.normal(0, 0.2)
    return np.maximum(color, 0.02) / np.maximum(color, 0.02).mean()


def add_lamp(rng: np.random.Generator, name: str, kind: str, room: Room, distance: float,
             irradiance: float) -> bpy.types.Object:
    """A lamp of Blender's with the power that brings `irradiance` to a point at this distance."""
    lamp = bpy.data.lights.new(name, kind)
    lamp.color = random_light_color(rng)
    if kind == "AREA":
        lamp.shape = str(rng.choice(["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"]))
        lamp.size, lamp.size_y = rng.uniform(0.1, 0.4 if room.has_ceiling else 1.2, 2)
        lamp.energy = irradiance * np.pi * distance**2
    elif kind == "SUN":
        lamp.angle, lamp.energy = np.radians(rng.uniform(0.5, 15)), irradiance
    else:
        lamp.shadow_soft_size = rng.uniform(0.01, 0.05 if room.has_ceiling else 0.2)
        lamp.energy = irradiance * 4 * np.pi * distance**2
    if kind == "SPOT":
        lamp.spot_size, lamp.spot_blend = np.radians(rng.uniform(25, 90)), rng.uniform(0, 1)
    return add_object(name, lamp)


def add_emitter(rng: np.random.Generator, name: str, kind: str, room: Room, position: np.ndarray,
                irradiance: float) -> bpy.types.Object:
    """The paper's equilateral triangle, or a small glowing polyhedron, still at the origin.

    Its radiance brings `irradiance` to the origin from `position`.
    """
    scale = 0.6 if room.has_ceiling else 1.0
    if kind == "triangle":
        points = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]]) * 0.025 * rng.uniform(2.0, 2.5) * scale
        faces = [(0, 1, 2)]
    else:
        points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        points = points * rng.uniform(0.03, 0.1) * scale
        faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    points = points - points.mean(axis=0)
    area = sum(np.linalg.norm(np.cross(points[b] - points[a], points[c] - points[a])) / 2 for a, b, c in faces)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    radiance = radiance_for(irradiance, position, area, is_closed=kind == "mesh")
    mesh.materials.append(emissive_material(random_light_color(rng), radiance))
    emitter = add_object(name, mesh)
    emitter.rotation_euler = rng.uniform(-np.pi, np.pi, 3)
    return emitter


def build_panel(rng: np.random.Generator, room: Room, name: str, irradiance: float) -> bpy.types.Object:
    """A thin closed box, up to 2 x 2 x 0.05, that brings `irradiance` to the origin; SCREEN of them show a picture."""
    width = rng.uniform(0.3, 0.8) if room.has_ceiling else rng.uniform(0.4, 2.0)
    size = width * np.array([1.0, rng.uniform(0.4, 1.0), PANEL_THICKNESS * rng.uniform(0.5, 1.5)])
    mesh = make_box(name, -size / 2, size / 2)
    set_box_uv(mesh)
    position = random_position(rng, room)
    area = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    radiance = radiance_for(irradiance, position, area, is_closed=True)
    mesh.materials.append(screen_material(rng, radiance) if rng.uniform() < SCREEN else
                          emissive_material(random_light_color(rng), radiance))
    panel = add_object(name, mesh)
    panel.location = position
    panel.rotation_euler = Vector(rng.uniform(-0.2, 0.2, 3) - position).to_track_quat("-Z", "Y").to_euler()
    panel.visible_camera = bool(rng.uniform() < PANEL_VISIBLE)
    return panel


def screen_material(rng: np.random.Generator, radiance: float) -> bpy.types.Material:
    """Radiates a two-coloured pattern with this mean."""
    values = blend_colors(make_pattern(rng), *(np.array(random_color(rng, "object")) for _ in range(2)))
    material = emissive_material(np.ones(3), radiance / max(values.mean(), 0.02))
    image = make_image("screen", values, is_color=True)
    link_image(material, image, principled(material).inputs["Emission Color"])
    return material


def radiance_for(irradiance: float, position: np.ndarray, area: float, *, is_closed: bool) -> float:
    """W/(m^2 sr) of a surface that brings `irradiance` to the origin, the mean over all ways in which it may turn.

    Both sides radiate, or the outside of a closed surface.
    """
    projected = area / 4 if is_closed else area / 2
    return irradiance * max(np.linalg.norm(position), 0.3) ** 2 / projected
