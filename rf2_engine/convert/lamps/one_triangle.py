# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as training scenes of the published weights have them: one small triangle each (docs/scene-input.md 6.3)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model.geometry import area_vectors
from ....model.normalize import central_irradiance
from ....model.scene import RenderScene

AREA = 0.011           # network units; theirs have 0.0087 to 0.0135
NEAREST, FARTHEST = 2.1, 2.7  # network units that theirs are away
WITHIN = 0.5           # of a lamp that is as near, its place is kept: others would cast other shadows


def one_triangle(lamp: RenderScene, center: np.ndarray, scale: float) -> RenderScene:
    """The same light at the scene's center, (3,) in the world, from one triangle that faces it.

    scale: network units in one of the world's. A lamp between the scene and the distance of the training is moved out
    along its direction, and one that is farther away is brought near. Beams become light to all sides.
    """
    emits = lamp.is_light
    weight = np.linalg.norm(area_vectors(lamp.triangles[emits].astype(np.float64)), axis=1)
    middle = np.average(lamp.triangles[emits].mean(axis=1), axis=0, weights=weight + 1e-30)
    away = (middle - center) * scale
    distance = float(np.linalg.norm(away))
    back = away / distance if distance > 1e-6 else np.array([0.0, 0.0, 1.0])
    if distance > WITHIN:
        distance = float(np.clip(distance, NEAREST, FARTHEST))
    position = center + back * distance / scale
    right = np.cross(back, (1.0, 0.0, 0.0) if abs(back[0]) < 0.9 else (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    radius = np.sqrt(AREA * 4 / (3 * np.sqrt(3))) / scale  # of the circle through the corners
    turns = -2 * np.pi * np.arange(3) / 3  # its front looks at the center
    corners = position + radius * (np.cos(turns)[:, None] * right + np.sin(turns)[:, None] * up)
    emission = np.average(lamp.emission[emits], axis=0, weights=weight + 1e-30)[None]
    triangle = replace(
        lamp, triangles=corners[None].astype(np.float32), normals=np.tile(-back, (1, 3, 1)).astype(np.float32),
        emission=emission.astype(np.float32), beam_axis=np.zeros((1, 3), np.float32),
        beam_cosine=np.zeros((1, 2), np.float32), tile_index=lamp.tile_index[emits][:1], seen=np.zeros(1, bool),
        light_group=None if lamp.light_group is None else lamp.light_group[:1])
    target = central_irradiance(lamp, np.float32(center), scale).sum()
    irradiance = central_irradiance(triangle, np.float32(center), scale).sum()
    return replace(triangle, emission=(triangle.emission * (target / max(irradiance, 1e-30))).astype(np.float32))
