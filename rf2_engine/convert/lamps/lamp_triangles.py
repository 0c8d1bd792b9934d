# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender lamps to emitting triangles (docs/scene-input.md 6.4, factors of unnormalised lamps measured in Cycles).

Radiance leaves a lamp triangle through its front only, within its beam (model/scene.py, `beam_axis`).
"""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....model.beams import spread_borders
from ....model.geometry import area_vectors
from ....model.scene import HALF_SPACE, RenderScene
from ..data.copied import LampInstance, Sun
from ..data.report import Report
from . import shapes
from .beams import Cone, find_spot_beam
from .lamp_power import ball_power, compute_lamp_light, normalized
from .placed_lamp import BoundingSphere, Detail, PlacedLamp, beams, find_half_angle, rotation
from .shapes import DARK, black, shining

BALL_RADIUS = 0.001           # of the scene radius: least size of a point or spot lamp
SUN_ANGLE = math.radians(0.5)  # least diameter of a sun
SUN_DISTANCE = 50             # scene radii
LEAST_SPREAD = math.radians(0.5)  # of an area lamp, whose size blurs narrower beams anyway,
WIDEST_SPREAD = math.pi - 0.01    # and from which on it has none
CELL = 0.35                   # scene radii: target for the side of one cell of an area lamp
CELLS_OF_TEXTURE = 6  # along a side, at least
DOWN, NOWHERE = np.array([0.0, 0.0, -1.0]), np.zeros(3)  # where a lamp shines in its frame; of light without a beam
WIDEST_SHADE = math.radians(80)  # of the black shade around a lamp that shines one way
FINE, COARSE = Detail(20, 12, 8, 4), Detail(8, 6, 4, 1)


def convert_light(instance: LampInstance, sphere: BoundingSphere, report: Report, detail: Detail = FINE) -> RenderScene:
    """Triangles of one lamp, ready for `RenderScene.appended`."""
    lamp = _place(instance, sphere, report, detail)
    if lamp is None:
        return DARK
    shape = CONVERTERS[lamp.light.type](lamp)
    return replace(shape, is_rough_guess=np.ones(len(shape), bool)) if lamp.is_rough_guess else shape


def convert_sun_lamp(instance: LampInstance, sphere: BoundingSphere, report: Report) -> Sun | None:
    """A sun lamp as a Sun; None if it emits no light."""
    lamp = _place(instance, sphere, report, FINE)
    return None if lamp is None else _sun(lamp)


def _place(instance: LampInstance, sphere: BoundingSphere, report: Report, detail: Detail) -> PlacedLamp | None:
    """None for a lamp that emits no light, perhaps with a remark."""
    light, name, matrix = instance.light, instance.name, instance.matrix
    frame = rotation(matrix)
    distance = float(np.linalg.norm(matrix[:3, 3] - sphere.center))
    light_output = compute_lamp_light(light, name, report, frame, distance)
    if light_output is None:
        return None
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if not all(scale[axis] for axis in NEEDED_AXES[light.type]):
        report.skipped(name, "its scale is 0, so it gives no light: reset its scale")
        return None
    return PlacedLamp(instance, light_output, report, frame, scale, sphere, detail, light_output.is_rough_guess)


def _area(lamp: PlacedLamp) -> RenderScene:
    """The lamp's own shape, and a black copy just behind it."""
    light = lamp.light
    second = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    size = np.array([light.size, second]) * lamp.scale[:2]
    if size.min() == 0:
        lamp.report.skipped(lamp.name, "an area lamp of size 0 gives no light")
        return DARK
    if light.shape in ("DISK", "ELLIPSE"):
        front = back = shapes.disk(*size, lamp.detail.disk_corners)
    else:
        fewest = 1 if lamp.light_output.texture is None else CELLS_OF_TEXTURE
        cells = np.ceil(size / (CELL * lamp.sphere.radius)).clip(fewest).clip(max=lamp.detail.most_cells).astype(int)
        front, back = shapes.rectangle(*size, *cells), shapes.rectangle(*size)
    gain, border = 1.0, HALF_SPACE
    if light.spread < WIDEST_SPREAD:
        gain, border = spread_borders(max(light.spread, LEAST_SPREAD))
    per_watt = 1 / (math.pi * (shapes.area(front) if normalized(light) else 1))
    scene = black(lamp.to_world(back[:, ::-1] + [0, 0, 0.01 * size.min()]))
    for strength, axis, cosines in beams(lamp, Cone(gain * lamp.strength, DOWN, border), facing=True):
        radiance = per_watt * strength * _textured(front, size, lamp.light_output.texture)
        scene = shining(lamp.to_world(front), radiance, lamp.frame @ axis, cosines).appended(scene)
    return scene


def _textured(front: np.ndarray, size: np.ndarray, texture: np.ndarray | None) -> np.ndarray:
    """(n, 3) or (1,) light of each triangle of an area lamp, relative to its mean: that of the nearest texels."""
    if texture is None:
        return np.ones(1)
    across = (np.arange(len(texture)) + 0.5) / len(texture) - 0.5
    at = np.stack(np.meshgrid(across, across, indexing="xy"), axis=-1).reshape(-1, 2) * size
    nearest = np.linalg.norm(at[:, None] - front.mean(axis=1)[None, :, :2], axis=-1).argmin(axis=1)
    share, areas = np.ones((len(front), 3)), np.linalg.norm(area_vectors(front), axis=-1)
    for i in range(len(front)):
        if (nearest == i).any():
            share[i] = texture.reshape(-1, 3)[nearest == i].mean(axis=0)
    return share * areas.sum() / np.maximum(areas @ share, 1e-30)


def _point(lamp: PlacedLamp) -> RenderScene:
    return _ball(lamp, beams(lamp, Cone(lamp.strength, NOWHERE, (0.0, 0.0))), half_angle=math.pi)


def _spot(lamp: PlacedLamp) -> RenderScene:
    x, y, z = lamp.scale
    if abs(x - y) > 1e-3 * max(x, y):
        lamp.guessed("its scale is not uniform: in estimated light its elliptic spot cone is round")
    cosines = find_spot_beam(lamp.light, math.sqrt(x * y) / max(z, 1e-12))
    return _ball(lamp, beams(lamp, Cone(lamp.strength, DOWN, cosines)), half_angle=math.acos(cosines[0]))


def _ball(lamp: PlacedLamp, cones: list[Cone], half_angle: float) -> RenderScene:
    """A ball for each beam, and a black shade that makes the cone for a network that does not know beams."""
    size = _ball_radius(lamp)
    triangles = shapes.ball(size, lamp.detail.ball_faces)
    scene, softened = DARK, _softened(lamp)
    for strength, axis, cosines in cones:
        radiance = softened * ball_power(lamp.light, strength) / (math.pi * shapes.area(triangles))
        scene = scene.appended(shining(lamp.to_world(triangles), radiance, lamp.frame @ axis, cosines))
    if softened < 1:
        scene = replace(scene, softened=np.full(len(scene), softened, np.float32))
    if lamp.light_output.directions is not None:
        half_angle = min(half_angle, find_half_angle(lamp.light_output.directions))
    if half_angle > WIDEST_SHADE and lamp.light.type != "SPOT":
        return scene
    return scene.appended(black(lamp.to_world(shapes.shade(half_angle, size, lamp.detail.shade_sides))))


def _softened(lamp: PlacedLamp) -> float:
    """Factor of Soft Falloff: Cycles takes a disk that faces the point it lights, here the center of the scene."""
    away = max(float(np.linalg.norm(lamp.position - lamp.sphere.center)), lamp.sphere.radius / 2)
    return 1 / (1 + (lamp.light.shadow_soft_size / away) ** 2) if lamp.light.use_soft_falloff else 1.0


def _ball_radius(lamp: PlacedLamp) -> float:
    size, least = lamp.light.shadow_soft_size, BALL_RADIUS * lamp.sphere.radius
    if size < 0.99 * least:
        lamp.approximated(f"its radius is {least:.3g} instead of {size:.3g}: estimated shadows are softer")
    return max(size, least)


def _sun(lamp: PlacedLamp) -> Sun:
    own = lamp.light.angle
    if own < 0.99 * SUN_ANGLE:
        was, now = math.degrees(own), math.degrees(SUN_ANGLE)
        lamp.approximated(f"the sun's angle is {now:.2g} instead of {was:.2g} degrees: estimated shadows are "
                          "softer")
    disk = math.pi * math.sin(own / 2) ** 2 if own and not normalized(lamp.light) else 1.0
    return Sun(lamp.frame[:, 2], lamp.strength * disk, own)


def convert_sun(sun: Sun, sphere: BoundingSphere, detail: Detail) -> RenderScene:
    """A distant disk that fills the sun's solid angle, seen from the middle of the scene."""
    pose = np.eye(3)
    pose[:, 2] = sun.toward
    frame, angle = rotation(pose), np.clip(sun.angle, SUN_ANGLE, math.radians(170))
    distance = SUN_DISTANCE * sphere.radius
    size = 2 * distance * math.tan(angle / 2)
    triangles = shapes.disk(size, size, detail.disk_corners) @ frame.T + sphere.center
    triangles += distance * frame[:, 2]
    return shining(triangles, sun.irradiance / (math.pi * math.sin(angle / 2) ** 2), -frame[:, 2], HALF_SPACE)


NEEDED_AXES = {"AREA": (0, 1, 2), "POINT": (), "SPOT": (0, 1, 2), "SUN": (2,)}  # at scale 0 Cycles shows no light
CONVERTERS = {
    "AREA": _area, "POINT": _point, "SPOT": _spot,
    "SUN": lambda lamp: convert_sun(_sun(lamp), lamp.sphere, lamp.detail),
}
