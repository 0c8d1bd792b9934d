# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras outside or inside the room, used only when they see something (docs/scene-input.md 1.2)."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import bpy
import numpy as np

from mathutils import Matrix, Vector

from .meshes import add_object
from .rooms import Room

GRID = 12             # rays per side of the test picture
TRIES = 40
LEAST_COVERED = 0.45  # of the picture
LEAST_OBJECTS = 0.07
NEAREST = 0.12

# Fields of view, radians.
INTERIOR_ANGLES = np.radians((40.0, 85.0))  # as rooms need them
WIDE_ANGLES = np.radians((20.0, 90.0))

# The wide profile.
DISTANCES = 0.6, 2.5       # in units of the distance at which the objects fill the picture
OBJECTS_RADIUS = 0.6       # of the objects together
CLIP_END = 1e5
WIDE_COVERED = {"room": 0.45, "ground": 0.3, "sky": 0.1}

Proposal = tuple[Matrix, float]  # camera-to-world, and the field of view in radians


class Setup(NamedTuple):
    """The cameras of the open file, and how they are to be rendered."""

    cameras: list[bpy.types.Object]
    token_budget: int = 3072  # most triangles of the RenderScene
    resolution: int = 128     # pixels, both sides


def build_cameras(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras of the full and the paper profile, as `find_views` gives them."""
    is_inside = room.kind == "closed_box" or (room.kind != "floor" and rng.uniform() < 0.2)

    def propose() -> Proposal:
        pose = inside_pose(rng, room) if is_inside else outside_pose(rng, room)
        return pose, rng.uniform(np.radians(45 if is_inside else 30), np.radians(60))

    return find_views(count, propose)


def build_interior_cameras(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras of the indirect profile, all of them in the room, as `find_views` gives them."""
    return find_views(count, lambda: (inside_pose(rng, room), rng.uniform(*INTERIOR_ANGLES)))


def build_wide_cameras(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras of the wide profile: near and far with any lens, also from below where there is no ground."""
    def propose() -> Proposal:
        angle = np.exp(rng.uniform(*np.log(WIDE_ANGLES)))
        return inside_pose(rng, room) if room.kind == "closed_box" else orbit_pose(rng, room, angle), angle

    cameras = find_views(count, propose, WIDE_COVERED["room" if room.walls else "ground" if room.surfaces else "sky"])
    for camera in cameras or ():
        camera.data.clip_end = CLIP_END
    return cameras


def find_views(count: int, propose: Callable[[], Proposal],
               least_covered: float = LEAST_COVERED) -> list[bpy.types.Object] | None:
    """`count` cameras that see enough, of at most TRIES proposals for each; None when there is no good view.

    The depsgraph must be up to date.
    """
    cameras = []
    for i in range(count):
        for _ in range(TRIES):
            pose, angle = propose()
            if sees_enough(pose, angle, least_covered):
                break
        else:
            return None
        cameras.append(add_camera(f"camera {i}", pose, angle))
    return cameras


def add_camera(name: str, pose: Matrix, angle: float) -> bpy.types.Object:
    data = bpy.data.cameras.new(name)
    data.angle, data.clip_start = angle, 0.001
    camera = add_object(name, data)
    camera.matrix_world = pose
    return camera


def outside_pose(rng: np.random.Generator, room: Room) -> Matrix:
    """On the open side of the walls, looking at the middle."""
    azimuth = -np.pi / 2 + rng.uniform(-room.spread, room.spread)
    elevation = np.radians(rng.uniform(0, 25) if room.has_ceiling else rng.uniform(5, 60))
    target = rng.uniform(-0.2, 0.2, 3)
    return look_at(rng, target + rng.uniform(1.5, 2.0) * spherical_direction(azimuth, elevation), target)


def orbit_pose(rng: np.random.Generator, room: Room, angle: float) -> Matrix:
    """At a distance that suits the lens, on the open side of the walls and above the ground if there is one."""
    azimuth = -np.pi / 2 + rng.uniform(-room.spread, room.spread)
    lowest, highest = (0, 25) if room.has_ceiling else (2, 65) if room.surfaces else (-60, 60)
    elevation = np.radians(rng.uniform(lowest, highest))
    target = rng.uniform(-0.3, 0.3, 3)
    distance = OBJECTS_RADIUS / np.tan(angle / 2) * np.exp(rng.uniform(*np.log(DISTANCES)))
    return look_at(rng, target + distance * spherical_direction(azimuth, elevation), target)


def inside_pose(rng: np.random.Generator, room: Room) -> Matrix:
    """Near a wall of the room, looking at its middle."""
    azimuth = rng.uniform(-np.pi, np.pi)
    reach = 0.93 * min(room.half, 0.75)
    flat = np.array([np.cos(azimuth), np.sin(azimuth)])
    flat *= reach / np.abs(flat).max() * rng.uniform(0.85, 1.0)
    position = np.array([*flat, room.floor + min(room.height, 1.0) * rng.uniform(0.2, 0.9)])
    target = np.array([*rng.uniform(-0.25, 0.25, 2), room.floor + rng.uniform(0.1, 0.5)])
    return look_at(rng, position, target)


def spherical_direction(azimuth: float, elevation: float) -> np.ndarray:
    """(3,) unit vector, from radians."""
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def look_at(rng: np.random.Generator, position: np.ndarray, target: np.ndarray) -> Matrix:
    """Camera-to-world whose up is +Z with the paper's jitter."""
    back = position - target
    back /= np.linalg.norm(back)
    right = np.cross(np.array([0, 0, 1]) + rng.uniform(-0.1, 0.1, 3), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return Matrix(pose.tolist())


def sees_enough(pose: Matrix, angle: float, least_covered: float) -> bool:
    """Casts GRID x GRID rays: enough must hit something, some of them an object, none of them something very near."""
    scene, depsgraph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    eye, turn, reach = pose.translation, pose.to_3x3(), np.tan(angle / 2)
    covered = objects = 0
    for y in np.linspace(-reach, reach, GRID):
        for x in np.linspace(-reach, reach, GRID):
            is_hit, position, _, _, hit_object, _ = scene.ray_cast(depsgraph, eye,
                                                                   turn @ Vector((x, y, -1.0)).normalized())
            if is_hit and (position - eye).length < NEAREST:
                return False
            covered += is_hit
            objects += is_hit and hit_object.name.startswith("object")
    return covered >= least_covered * GRID**2 and objects >= LEAST_OBJECTS * GRID**2
