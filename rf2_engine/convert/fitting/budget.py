# SPDX-License-Identifier: GPL-3.0-or-later
"""Decide how many triangles each mesh keeps, so that Max Triangles is spent where it is visible
(docs/scene-input.md 2.3).

A mesh of curvature k whose n triangles cover a of the picture is wrong by about k a sqrt(1 / n). The sum over all
meshes is least where n is proportional to (k a)^(2/3).
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ....model import progress
from ....model.geometry import area_vectors
from ..data.cache import ConversionCache
from ..data.collected import CollectedScene, Part
from ..data.mesh import TriangleMesh
from ..data.report import Report
from ..meshes import reduce
from ..meshes.reduce import COARSEST, KEPT_WHOLE
from .apparent_size import ApparentSize, ApparentSpace
from .framing import Framing
from .instances import copies_of, drop_instances, middles_and_scales
from .visible import GRID, VisiblePoints

HIDDEN = 0.05      # how much of the picture counts that something would fill if it were not hidden
LEVEL = 8          # ratio of the apparent sizes from which on instances are simplified apart from each other
LEVELS = 5
SAMPLE = 20_000    # triangles that tell how curved a mesh is
TEXTURE, FLAT = 1.0, 0.1  # curvature that textures, and the lack of both, are worth


@dataclass
class Simplification:
    """How parts of a scene are simplified."""

    parts: list[Part]
    targets: np.ndarray              # (k,) triangles that a part may keep
    nearest: list[np.ndarray]         # (4, 4) object to world, of the instance that shows most
    apparent: ApparentSize | None

    def apply(self, report: Report, cache: ConversionCache | None = None) -> None:
        """Simplify what is too fine; cache: of earlier conversions."""
        before: dict[str, list[int]] = {}
        for i, (part, target, matrix) in enumerate(zip(self.parts, self.targets, self.nearest, strict=True)):
            if target >= len(part.mesh):
                continue
            area, count = part.mesh.area, len(part.mesh)
            if part.real is None:
                part.real = part.mesh
            space = None if self.apparent is None else ApparentSpace(matrix, self.apparent)
            with progress.part(i / len(self.parts), (i + 1) / len(self.parts),
                               f"Simplifying meshes, {i + 1} of {len(self.parts)}"):
                simplified = partial(reduce.simplify, part.mesh, int(target), space)
                if cache is None:
                    part.mesh = simplified()
                else:
                    key = part.mesh.digest, int(target), matrix.tobytes(), self.apparent
                    part.mesh = cache.get(key, lambda _, work=simplified: work(), report)
            part.flux_gain *= area / part.mesh.area
            before.setdefault(part.name, [count]).append(len(part.mesh))
        for name, (count, *after) in before.items():
            to = f"{min(after)}" if min(after) == max(after) else f"{min(after)} to {max(after)}"
            report.approximated(name, f"simplified from {count} to {to} triangles")


def allot_triangles(collected: CollectedScene, budget: int, framing: Framing, hits: VisiblePoints | None,
                    targets: list[int], report: Report) -> Simplification:
    """Allot triangles to all parts; the least visible instances are left out where not even coarse shapes of all fit.

    targets: triangles of each part, including those by which it will be subdivided; hits: None where there is no
    camera, and everything counts alike.
    """
    parts, apparent = collected.parts, framing.apparent
    counts, copies = _counts(parts)
    if not parts or counts @ copies <= budget:
        framing.shares = {} if framing.shares is None else framing.shares
        return Simplification([], np.zeros(0, np.int64), [], apparent)
    shares_of_picture = _shares_of_picture(parts, apparent, hits)
    parts, shares_of_picture, targets = _levels(*drop_instances(parts, shares_of_picture, targets, budget, report))
    collected.parts = parts
    counts, copies = _counts(parts)
    detail = np.array([_curvature(part.mesh) + (TEXTURE if part.is_textured else FLAT) for part in parts])
    weights = (np.array([share.max() for share in shares_of_picture]) * detail) ** (2 / 3)
    shares = share_budget(np.maximum(counts, targets), copies, weights, budget)
    shares = framing.stabilize(_names(parts), shares, counts, copies, budget)
    nearest = [part.matrices[in_picture.argmax()] for part, in_picture in zip(parts, shares_of_picture, strict=True)]
    return Simplification(parts, shares, nearest, apparent)


def _counts(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """(k,) i64 triangles of the mesh of each part, and (k,) i64 instances of it."""
    return np.array([len(part.mesh) for part in parts], np.int64), np.array(list(map(copies_of, parts)), np.int64)


def share_budget(counts, copies, weights, budget: int) -> np.ndarray:
    """(k,) int triangles each mesh may keep so that sum(copies * result) <= budget.

    counts: (k,) triangles per mesh; copies: (k,) instances of it; weights: (k,) > 0, what it is worth. Shares are in
    proportion to the weights, small meshes are kept whole while half of the budget suffices, and none gets less than
    `COARSEST`: for that many the budget must suffice.
    """
    counts, copies, weights = np.asarray(counts, np.int64), np.asarray(copies, np.int64), np.asarray(weights, float)
    if counts @ copies <= budget:
        return counts
    floor = KEPT_WHOLE
    while floor > COARSEST and np.minimum(counts, floor) @ copies > budget / 2:
        floor //= 2
    low, high = 0.0, float(counts.max() / weights.min())
    for _ in range(60):
        middle = (low + high) / 2
        fits = _shares(counts, floor, middle * weights) @ copies <= budget
        low, high = (middle, high) if fits else (low, middle)
    return _shares(counts, floor, low * weights)


def _shares(counts: np.ndarray, floor: int, targets: np.ndarray) -> np.ndarray:
    return np.minimum(counts, np.maximum(floor, targets.astype(np.int64)))


def _names(parts: list[Part]) -> list[tuple]:
    """What tells the parts apart, in the next frame too: objects of one name have levels and kinds."""
    counts: dict[tuple, int] = {}
    names = []
    for part in parts:
        name = part.name, part.emits
        counts[name] = counts.get(name, -1) + 1
        names.append((*name, counts[name]))
    return names


def _shares_of_picture(parts: list[Part], apparent: ApparentSize | None,
                       hits: VisiblePoints | None) -> list[np.ndarray]:
    """The share of the picture, 0 to 1, that the instances of each part count for: (m,) > 0 for each of the parts."""
    covered = np.zeros(sum(map(copies_of, parts)))
    if hits is not None:
        covered += np.bincount(hits.instance[hits.instance >= 0], minlength=len(covered)) / GRID ** 2
    shares = []
    for part in parts:
        own, covered = covered[:copies_of(part)], covered[copies_of(part):]
        middle, scale = middles_and_scales(part)
        area = part.mesh.area * scale ** 2
        if apparent is None:
            shares.append(area + 1e-30)
            continue
        away = middle - apparent.eye
        radius = np.linalg.norm(np.ptp(part.mesh.bounds, axis=0)) / 2 * scale
        distance = np.linalg.norm(away, axis=1)
        unoccluded = (area / 4 / (distance - radius).clip(apparent.near) ** 2 / apparent.solid_angle).clip(0, 1)
        angle = np.arccos((away @ apparent.axis / distance.clip(1e-30)).clip(-1, 1))
        ahead = angle - np.arcsin((radius / distance.clip(1e-30)).clip(0, 1)) < np.arccos(apparent.cosine)
        is_missed = ahead & ((unoccluded < 2 / GRID ** 2) | part.emits)  # too small for rays, or transparent to them
        shares.append(np.maximum(own, np.where(is_missed, unoccluded, HIDDEN * unoccluded)) + 1e-12)
    return shares


def _levels(parts: list[Part], shares_of_picture: list[np.ndarray], targets):
    """Parts whose instances look unlike in size become several, so that near ones are finer than far ones."""
    split = []
    for part, share, target in zip(parts, shares_of_picture, targets, strict=True):
        level = np.minimum(np.log(share.max() / share) / np.log(LEVEL), LEVELS - 1).astype(int)
        if len(part.mesh) <= COARSEST:
            level[:] = 0
        for one in np.unique(level):
            rows = np.flatnonzero(level == one)
            split.append((replace(part, instances=[part.instances[i] for i in rows]), share[rows], target))
    return [list(column) for column in zip(*split)]


def _curvature(mesh: TriangleMesh) -> float:
    """Mean curvature times the size of the surface, about: 0 for a plane, 1 to 2 for a ball."""
    corners = mesh.corners[:: max(len(mesh) // SAMPLE, 1)].astype(np.float64)
    cells = int(np.clip(np.sqrt(len(corners) / 24), 1, 16))
    normals, middle = area_vectors(corners), corners.mean(axis=1)
    low, extent = middle.min(axis=0), max(float(np.ptp(middle, axis=0).max()), 1e-30)
    cell = ((middle - low) * (cells / extent)).astype(int).clip(0, cells - 1) @ (1, cells, cells ** 2)
    total = np.linalg.norm(normals, axis=1).sum()
    sums = np.stack([np.bincount(cell, normals[:, i]) for i in range(3)], axis=1)
    spread = 1 - np.linalg.norm(sums, axis=1).sum() / total
    return float(cells * np.sqrt(2 * max(spread, 0) * total) / extent / 3) if total else 0.0
