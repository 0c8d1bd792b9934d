# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender lamps to emitting triangles (docs/scene-input.md 6.4, factors of unnormalised lamps measured in Cycles).

Radiance leaves a lamp triangle through its front only, within its beam (model/scene.py, `beam_axis`).
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...model.scene import RenderScene, constant_tile
from . import proxies
from .beam import HALF_SPACE, spot_beam, spread_beam
from .lamp_power import ball_power, lamp_strength, normalized
from .suns import Sun

BALL_RADIUS = 0.01            # of the scene radius: least size of a point or spot lamp
SUN_ANGLE = math.radians(3)   # least diameter of a sun
SUN_DISTANCE = 50             # scene radii
LEAST_SPREAD = math.radians(2)  # of an area lamp: narrower beams are lost in the precision of their cosines
CELL = 0.35                   # scene radii: wanted side of one cell of an area lamp
TILES = np.stack([constant_tile((1, 1, 1), roughness=1, ior=1), constant_tile((0, 0, 0), roughness=1, ior=1)])
EMITTING, BLACK = 0, 1        # rows of TILES


@dataclass(frozen=True)
class Detail:
    """Of how many triangles the shapes are that stand in for lamps."""

    ball_faces: int
    disk_corners: int
    shade_sides: int
    most_cells: int  # along one side of an area lamp


FINE, COARSE = Detail(20, 12, 8, 4), Detail(8, 6, 4, 1)


@dataclass
class PlacedLamp:
    """A lamp's strength, its pose without scale (it shines along -Z), and the scene it stands in."""

    light: object             # bpy Light
    strength: np.ndarray      # (3,)
    name: str
    report: object
    place: np.ndarray         # (3,)
    frame: np.ndarray         # (3, 3) rotation
    scale: np.ndarray         # (3,)
    scene_center: np.ndarray  # (3,)
    scene_radius: float
    detail: Detail

    @property
    def beam_axis(self) -> np.ndarray:
        return -self.frame[:, 2]

    def placed(self, triangles: np.ndarray) -> np.ndarray:
        return triangles @ self.frame.T + self.place

    def approximated(self, message: str) -> None:
        self.report.approximated(self.name, message)


def convert_light(matrix_world: np.ndarray, light, name: str, report, center: np.ndarray, radius: float,
                  detail: Detail = FINE) -> RenderScene:
    """Triangles of one lamp, ready for `RenderScene.appended`.

    matrix_world: (4, 4) of the object; light: bpy Light; name: of the object, for the report; center (3,) and radius:
    bounding sphere of the scene, world units, which decides where a sun stands and how small a lamp may be.
    """
    matrix, center = np.asarray(matrix_world, np.float64), np.asarray(center, np.float64)
    strength = lamp_strength(light, name, report, float(np.linalg.norm(matrix[:3, 3] - center)))
    if strength is None:
        return DARK
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if not all(scale[axis] for axis in NEEDED_AXES[light.type]):
        report.skipped(name, "a lamp scaled to nothing gives no light: reset its scale")
        return DARK
    return CONVERTERS[light.type](PlacedLamp(
        light, strength, name, report, matrix[:3, 3], _rotation(matrix), scale, center, max(radius, 1e-6), detail))


def _area(lamp: PlacedLamp) -> RenderScene:
    """The lamp's own shape, and a black copy just behind it."""
    light = lamp.light
    second = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    size = np.array([light.size, second]) * lamp.scale[:2]
    if size.min() == 0:
        lamp.report.skipped(lamp.name, "an area lamp of size 0 gives no light")
        return DARK
    if light.shape in ("DISK", "ELLIPSE"):
        front = back = proxies.disk(*size, lamp.detail.disk_corners)
    else:
        cells = np.clip(np.ceil(size / (CELL * lamp.scene_radius)), 1, lamp.detail.most_cells).astype(int)
        front, back = proxies.rectangle(*size, *cells), proxies.rectangle(*size)
    spread = max(light.spread, LEAST_SPREAD)
    if light.spread < LEAST_SPREAD:
        was, now = math.degrees(light.spread), math.degrees(LEAST_SPREAD)
        lamp.approximated(f"its spread is {now:.0f} instead of {was:.2g} degrees")
    elif spread < math.pi - 0.01:
        lamp.approximated(f"a spread of {math.degrees(spread):.0f} degrees falls off a little differently")
    gain, cosines = spread_beam(spread)
    radiance = gain * lamp.strength / (math.pi * (proxies.area(front) if normalized(light) else 1))
    behind = back[:, ::-1] + [0, 0, 0.01 * size.min()]
    return _flat_scene(lamp.placed(front), radiance, lamp.beam_axis, cosines).appended(_black(lamp.placed(behind)))


def _point(lamp: PlacedLamp) -> RenderScene:
    triangles = proxies.ball(_ball_radius(lamp), lamp.detail.ball_faces)
    radiance = ball_power(lamp.light, lamp.strength) / (math.pi * proxies.area(triangles))
    return _flat_scene(triangles + lamp.place, radiance)


def _spot(lamp: PlacedLamp) -> RenderScene:
    """A ball with a beam, and a black shade that makes the cone for a network that does not know beams."""
    x, y, z = lamp.scale
    if abs(x - y) > 1e-3 * max(x, y):
        lamp.approximated("the elliptic cone of a spot scaled unevenly is shown round")
    cosines = spot_beam(lamp.light, math.sqrt(x * y) / max(z, 1e-12))
    size = _ball_radius(lamp)
    triangles = proxies.ball(size, lamp.detail.ball_faces)
    radiance = ball_power(lamp.light, lamp.strength) / (math.pi * proxies.area(triangles))
    shade = proxies.shade(math.acos(cosines[0]), size, lamp.detail.shade_sides)
    return _flat_scene(lamp.placed(triangles), radiance, lamp.beam_axis, cosines).appended(_black(lamp.placed(shade)))


def _ball_radius(lamp: PlacedLamp) -> float:
    size, least = lamp.light.shadow_soft_size, BALL_RADIUS * lamp.scene_radius
    if size < 0.99 * least:
        lamp.approximated(f"its radius is {least:.3g} instead of {size:.3g}: shadows are softer")
    return max(size, least)


def _sun(lamp: PlacedLamp) -> RenderScene:
    """A distant disk that fills the sun's solid angle, seen from the middle of the scene."""
    own = lamp.light.angle
    if own < SUN_ANGLE:
        was, now = math.degrees(own), math.degrees(SUN_ANGLE)
        lamp.approximated(f"the sun's angle is {now:.0f} instead of {was:.2g} degrees: shadows are softer")
    irradiance = lamp.strength * (1 if normalized(lamp.light) else math.pi * math.sin(own / 2) ** 2)
    return _distant_disk(irradiance, own, lamp.frame, lamp.scene_center, lamp.scene_radius, lamp.detail)


def convert_sun(sun: Sun, center: np.ndarray, radius: float, detail: Detail = FINE) -> RenderScene:
    """Triangles of a sun in the world; center (3,) and radius: bounding sphere of the scene, world units."""
    pose = np.eye(3)
    pose[:, 2] = sun.toward
    return _distant_disk(sun.irradiance, sun.angle, _rotation(pose), np.asarray(center, np.float64), max(radius, 1e-6),
                         detail)


def _distant_disk(irradiance, angle, frame, scene_center, scene_radius, detail: Detail) -> RenderScene:
    angle = np.clip(angle, SUN_ANGLE, math.radians(170))
    distance = SUN_DISTANCE * scene_radius
    size = 2 * distance * math.tan(angle / 2)
    triangles = proxies.disk(size, size, detail.disk_corners) @ frame.T + scene_center + distance * frame[:, 2]
    return _flat_scene(triangles, irradiance / (math.pi * math.sin(angle / 2) ** 2), -frame[:, 2], HALF_SPACE)


def _rotation(matrix: np.ndarray) -> np.ndarray:
    """(3, 3) orthonormal and right-handed: the lamp's +Z kept, scale, shear and mirror removed."""
    x, z = _unit(matrix[:3, 0]), _unit(matrix[:3, 2])
    x = x - z * (x @ z)
    x = _unit(x if np.linalg.norm(x) > 1e-6 else np.cross(z, np.eye(3)[np.abs(z).argmin()]))
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / (np.linalg.norm(vector) or 1)


def _black(triangles) -> RenderScene:
    return _flat_scene(triangles, np.zeros(3), tile=BLACK)


def _flat_scene(triangles, radiance, axis=(0, 0, 0), cosines=(0, 0), tile: int = EMITTING) -> RenderScene:
    """Flat triangles that share radiance, beam and tile."""
    n = len(triangles)

    def each(value, *shape):
        return np.broadcast_to(np.float32(value), (n, *shape)).copy()

    flat = np.repeat(proxies.normals(triangles)[:, None], 3, axis=1) if n else triangles
    return RenderScene(
        triangles=triangles.astype(np.float32), normals=flat.astype(np.float32), emission=each(radiance, 3),
        beam_axis=each(axis, 3), beam_cosine=each(cosines, 2), tile_index=np.full(n, tile, np.int32),
        tiles=TILES.copy(), seen=np.zeros(n, bool))


DARK = _flat_scene(np.zeros((0, 3, 3)), np.zeros(3))
NEEDED_AXES = {"AREA": (0, 1, 2), "POINT": (), "SPOT": (0, 1, 2), "SUN": (2,)}  # at scale 0 Cycles shows no light
CONVERTERS = {"AREA": _area, "POINT": _point, "SPOT": _spot, "SUN": _sun}
