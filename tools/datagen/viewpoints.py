# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras of the wide profile: lenses of 20 to 90 degrees, near and far, and from below where there is no ground."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Matrix

from .cameras import TRIES, add_camera, inside_pose, look_at, sees_enough
from .templates import Room

LENSES = np.radians((20.0, 90.0))
NEARNESS = 0.6, 2.5        # distance, in units of the one at which the objects fill the picture
RADIUS = 0.6               # of the objects together
FARTHEST_SEEN = 1e5
COVERED = {"room": 0.45, "ground": 0.3, "sky": 0.1}


def build_viewpoints(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras, or None when the scene has no good view. The depsgraph must be up to date."""
    cameras = []
    for i in range(count):
        for _ in range(TRIES):
            fov = np.exp(rng.uniform(*np.log(LENSES)))
            if room.kind == "closed_box":
                pose = inside_pose(rng, room)
            else:
                pose = around_pose(rng, room, fov)
            if sees_enough(pose, fov, COVERED["room" if room.walls else "ground" if room.surfaces else "sky"]):
                break
        else:
            return None
        cameras.append(add_camera(f"camera {i}", pose, fov))
        cameras[-1].data.clip_end = FARTHEST_SEEN
    return cameras


def around_pose(rng: np.random.Generator, room: Room, fov: float) -> Matrix:
    """At a distance that suits the lens, on the open side of the walls and above the ground if there is one."""
    azimuth = -np.pi / 2 + rng.uniform(-room.spread, room.spread)
    lowest, highest = (0, 25) if room.enclosed else (2, 65) if room.surfaces else (-60, 60)
    elevation = np.radians(rng.uniform(lowest, highest))
    target = rng.uniform(-0.3, 0.3, 3)
    distance = RADIUS / np.tan(fov / 2) * np.exp(rng.uniform(*np.log(NEARNESS)))
    direction = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return look_at(rng, target + distance * direction, target)
