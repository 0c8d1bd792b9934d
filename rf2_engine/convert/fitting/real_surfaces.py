# SPDX-License-Identifier: GPL-3.0-or-later
"""Match the meshes that were simplified with what they have become: rays meet the real ones, up to a limit."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.geometry import surfaces
from ..data.cache import ConversionCache
from ..data.collected import Part
from ..data.mesh import areas
from ..data.report import Report
from ..meshes.represent import represent

MOST = 4_000_000  # triangles that rays meet: about a gigabyte


def match_tokens(parts: list[Part], report: Report, cache: ConversionCache | None = None) -> None:
    """Find the token of each real triangle, for all parts that were simplified and divided.

    Where there are more than MOST real triangles, rays meet the simplified ones of those parts that have the most for
    each of their tokens. cache: of earlier conversions.
    """
    _limit(parts, report)
    simplified = [part for part in parts if part.real is not None]
    for i, part in enumerate(simplified):
        with progress.part(i / len(simplified), (i + 1) / len(simplified), "Matching meshes and their tokens"):
            if cache is None:
                part.real, part.token = represent(part.real, part.mesh, part.is_textured)
            else:
                key = "represent", part.real.digest, part.mesh.digest, part.is_textured
                part.real, part.token = cache.get(
                    key, lambda _, part=part: represent(part.real, part.mesh, part.is_textured), report)
        if part.emits and len(part.mesh) < len(part.real):
            part.flux_gain = np.float32(part.flux_gain) * _piece_gain(part)


def _piece_gain(part: Part) -> np.ndarray:
    """(n,) f32 of each triangle of a simplified mesh: separate pieces, such as letters, lose different shares of area.

    Each piece sends out the light of what it stands for; the mean over all is 1.
    """
    piece, own = surfaces(part.mesh.corners), areas(part.mesh.corners)
    lost = np.bincount(piece[part.token], areas(part.real.corners), piece.max() + 1) / np.bincount(piece, own)
    return (lost[piece] * own.sum() / (lost[piece] @ own)).astype(np.float32)


def _limit(parts: list[Part], report: Report) -> None:
    """Forget real meshes until there is room for the others."""
    total = sum(map(_count, parts))
    simplified = [part for part in parts if part.real is not None]
    for part in sorted(simplified, key=lambda part: len(part.real) / len(part.mesh), reverse=True):
        if total <= MOST:
            break
        total -= _count(part)
        report.approximated(part.name, f"rays meet {len(part.mesh)} of its {len(part.real)} triangles: the scene has "
                                       f"more than {MOST:,}")
        part.real = None
        total += _count(part)
    for part in sorted(parts, key=_count, reverse=True):
        if total <= MOST:
            break
        total -= _count(part)
        part.instances = [replace(instance, real_matrices=()) for instance in part.instances]
        report.approximated(part.name, f"rays meet {len(part.instances)} of its instances: the scene has more than "
                                       f"{MOST:,} triangles")
        total += _count(part)


def _count(part: Part) -> int:
    return len(part.real or part.mesh) * sum(max(len(instance.real_matrices), 1) for instance in part.instances)
