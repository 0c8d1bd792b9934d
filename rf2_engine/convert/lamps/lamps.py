# SPDX-License-Identifier: GPL-3.0-or-later
"""All lamps and suns of a scene as triangles, within their share of the budget."""
from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.beams import smoothed
from ....model.clusters import split_clusters
from ....model.geometry import area_vectors
from ....model.scene import RenderScene
from ..data.copied import LampInstance, Sun
from ..data.mesh import within_reach
from ..data.report import Report
from .lamp_triangles import COARSE, FINE, convert_light, convert_sun, convert_sun_lamp
from .placed_lamp import BoundingSphere, Detail
from .shapes import reach_of, reaching
from .suns import merge_suns

SUNS_SHARE = 0.25        # of the triangles, where there are too many
FACING, COLOR = 0.3, 0.1  # how much differences in these count beside a distance of the scene's radius


def convert_lamps(lamps: list[LampInstance], suns: list[Sun], budget: int, sphere: BoundingSphere,
                  clear: np.ndarray, report: Report) -> list[RenderScene]:
    """Triangles of each lamp and each sun; too many become coarser, and then close ones are merged.

    budget: most triangles of all together; clear (3,): the share of sunlight that reaches the scene.
    """
    sun_lamps = [(convert_sun_lamp(lamp, sphere, report), lamp) for lamp in lamps if _is_sun(lamp)]
    suns = suns + [replace(sun, irradiance=sun.irradiance * clear, reach=lamp.reach, light_group=lamp.light_group)
                   for sun, lamp in sun_lamps if sun is not None and clear.any()]
    lamps = [lamp for lamp in lamps if not _is_sun(lamp)]
    usual = 0
    for detail in FINE, COARSE:
        distant = _sun_disks(suns, sphere, detail, report)
        near = []
        for i, lamp in enumerate(lamps):
            progress.report(i / len(lamps))
            shape = convert_light(lamp, sphere, report, detail)
            shape = reaching(_within_numbers(shape, lamp.name, report), lamp.reach)
            near.append(_in_group(shape, lamp.light_group))
        near = [shape for shape in near if shape.is_light.any()]
        count = sum(map(len, near)) + sum(map(len, distant))
        if count < usual:
            report.approximated("Lamps", "in estimated light their shapes are coarser than usual: raise Max Triangles")
        if count <= budget:
            return near + distant
        usual = count
    most = max(int(SUNS_SHARE * budget) // max(map(len, distant), default=1), 1)
    if len(suns) > most:
        distant = _sun_disks(merge_suns(suns, most), sphere, COARSE, report)
    room, fewer = budget - sum(map(len, distant)), near
    most = max(room * len(near) // max(sum(map(len, near)), 1), 1)
    while sum(map(len, fewer)) > room and most > 0:
        fewer, most = _merge_lamps(near, most, sphere), int(0.9 * most)
    report.approximated("Lamps", f"in estimated light {len(fewer) + len(distant)} lights replace "
                                 f"{len(near) + len(suns)}, each with the light of those near it: raise Max Triangles")
    return fewer + distant


def split_negative(lamps: list[LampInstance]) -> tuple[list[LampInstance], list[LampInstance]]:
    """The lamps that give light, and those of negative strength, as if they gave it."""
    negated = []
    for lamp in lamps:
        if lamp.light.energy < 0:
            light = copy.copy(lamp.light)
            light.energy = -light.energy
            negated.append(replace(lamp, light=light))
    return [lamp for lamp in lamps if not lamp.light.energy < 0], negated  # NaN is neither


def _is_sun(lamp: LampInstance) -> bool:
    return lamp.light.type == "SUN"


def _sun_disks(suns: list[Sun], sphere: BoundingSphere, detail: Detail, report: Report) -> list[RenderScene]:
    return [_in_group(reaching(_within_numbers(convert_sun(sun, sphere, detail), "Sun", report), sun.reach),
                      sun.light_group) for sun in suns]


def _in_group(shape: RenderScene, group: int) -> RenderScene:
    return replace(shape, light_group=np.full(len(shape), group, np.int32)) if group else shape


def _within_numbers(shape: RenderScene, name: str, report: Report) -> RenderScene:
    """The lamp, or no triangles if it is too large or too far away; reports radiance that half floats cannot hold."""
    if not within_reach(shape.triangles).all():
        report.refused(name, "its size or location is too large: reset them")
        return RenderScene()
    return replace(shape, emission=report.finite(name, "its light", shape.emission))


def _merge_lamps(shapes: list[RenderScene], most: int, sphere: BoundingSphere) -> list[RenderScene]:
    """At most `most` lamps (or one of each kind and light group) that give as much light of each colour."""
    flux, positions, facing, kind = (np.array(rows) for rows in zip(*map(_summary, shapes), strict=True))
    power = flux.mean(axis=1)
    offset = positions - sphere.center
    # Outside of the scene only directions differ.
    offset = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), sphere.radius)
    features = np.concatenate([offset, FACING * facing, COLOR * flux / flux.sum(axis=1, keepdims=True)], axis=1)
    kind = np.unique(np.stack([kind.astype(np.uint64), *np.array([reach_of(shape) for shape in shapes], np.uint64).T]),
                     axis=1, return_inverse=True)[1].reshape(-1)
    kinds = [np.flatnonzero(kind == k) for k in np.unique(kind)]
    return [_merge_group(shapes, rows, flux, np.average(positions[rows], axis=0, weights=power[rows]), positions)
            for rows in split_clusters(features, power, kinds, most)]


def _summary(shape: RenderScene) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Flux (3,), middle (3,), direction (3,) (0 for all around) and kind of one lamp; those of a group are a kind."""
    emits, vectors = shape.is_light, area_vectors(shape.triangles[shape.is_light].astype(np.float64))
    areas, emission, axis = np.linalg.norm(vectors, axis=-1), shape.emission[emits], shape.beam_axis[emits]
    flat = np.linalg.norm(vectors.sum(axis=0)) > 0.5 * areas.sum()
    emission, border = smoothed(emission, shape.beam_cosine[emits])
    border = border.mean(axis=1).clip(-1, 1)
    share = np.where(axis.any(axis=1), 1 - border ** 2 if flat else (1 - border) / 2, 1)  # of light within the beam
    flux = np.pi * (areas * share)[:, None] * emission
    weight = flux.mean(axis=1)
    middle = np.average(shape.triangles[emits].mean(axis=1), axis=0, weights=weight)
    kind = 2 if flat else int(axis.any())
    return flux.sum(axis=0), middle, np.average(axis, axis=0, weights=weight), kind + 3 * int(shape.light_groups[0])


def _merge_group(shapes, rows, flux, middle, positions) -> RenderScene:
    """The brightest of some lamps, moved into the middle of all, with the light of all."""
    brightest = rows[flux[rows].mean(axis=1).argmax()]
    shape, total = shapes[brightest], flux[rows].sum(axis=0)
    emission = shape.emission.mean(axis=1, keepdims=True) * total / flux[brightest].mean()
    return replace(shape, triangles=(shape.triangles + (middle - positions[brightest])).astype(np.float32),
                   emission=emission.astype(np.float32))
