# SPDX-License-Identifier: GPL-3.0-or-later
"""Beams of lamps: borders as `beam_cosine` of model/scene.py has them.

Light that differs by direction is approximated with a few cones, chosen one after the other, each where most is missing
(matching pursuit, Mallat and Zhang 1993).
"""
from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from ....model.beams import beam_share
from ....model.scene import HALF_SPACE

EDGE = HALF_SPACE[1]                # least width, in cosines, of a beam's border
MOST = 4
WIDTHS = np.radians([8, 14, 22, 32, 45, 60, 75, 90, 120, 150])   # from the axis to the border
SOFTNESS = 0.1, 0.5, 1.0, 1.5                                    # of the border, over the way to the axis
AXES = 10                                                        # on which cones are tried, and two for what is missing
ENOUGH = 0.03                                                    # of the light in the wrong direction
ROUNDS = 100                                                     # in which strengths settle


def find_spot_beam(light, stretch: float) -> tuple[float, float]:
    """Cosines of a spot, `stretch` times as wide in the tangent as its angle says because its object is scaled.

    Cycles lets intensity rise with a smoothstep in the cosine from the border of the cone over `blend` of the way.
    """
    outer = math.cos(light.spot_size / 2)
    inner = outer + (1 - outer) * light.spot_blend
    angles = (math.acos(outer), math.acos(min(inner, 1)))
    outer, inner = (math.cos(math.atan2(stretch * math.sin(a), math.cos(a))) for a in angles)
    return outer, max(inner, outer + min(EDGE, (1 - outer) / 2))


class Cone(NamedTuple):
    strength: np.ndarray           # (3,) at its brightest
    axis: np.ndarray               # (3,) unit; 0 for light that is the same everywhere
    cosines: tuple[float, float]   # as `beam_cosine` of model/scene.py


@functools.cache
def sphere(count: int = 2048) -> np.ndarray:
    """(count, 3) f32 unit vectors spread evenly: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, math.pi * (3 - math.sqrt(5)) * k
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=-1).astype(np.float32)


def cones(light: np.ndarray, weight: np.ndarray) -> tuple[list[Cone], float]:
    """At most MOST cones that give `light` (n, 3) in the directions of `sphere(n)`, and the share that is misplaced.

    weight: (n,) of each direction; for each colour the weighted sum of the light stays what it is.
    """
    fitted, misplaced = _cones(np.float64(light).tobytes(), np.float64(weight).tobytes())
    return list(fitted), misplaced


@functools.lru_cache(maxsize=16)
def _cones(light: bytes, weight: bytes) -> tuple[tuple[Cone, ...], float]:
    """`cones`, computed once for all lamps of a kind."""
    light, weight = np.frombuffer(light).reshape(-1, 3), np.frombuffer(weight)
    total = (light * weight[:, None]).sum(axis=0)
    chosen, beams, strength, fit, misplaced = [], np.zeros((len(light), 0)), np.zeros((0, 3)), np.zeros_like(light), 1.0
    while len(chosen) < MOST and misplaced > ENOUGH:
        missing = (light - fit) * weight[:, None]
        candidates, sent = _candidates(missing.mean(axis=1), chosen)
        gain = np.linalg.norm(np.maximum(sent.T @ missing, 0), axis=1) / np.sqrt(weight @ sent ** 2 + 1e-12)
        best = int(gain.argmax())
        chosen, beams = [*chosen, candidates[best]], np.concatenate([beams, sent[:, best:best + 1]], axis=1)
        strength = _strengths(beams, light, weight)
        fit = beams @ strength
        scale = total / np.maximum((fit * weight[:, None]).sum(axis=0), 1e-30)
        fit, strength = fit * scale, strength * scale
        misplaced = float((np.abs(light - fit).mean(axis=1) * weight).sum() / max(total.mean(), 1e-30) / 2)
    return tuple(Cone(s, *cone) for s, cone in zip(strength, chosen, strict=True) if s.any()), misplaced


def _candidates(missing: np.ndarray, chosen: list):
    """Axes and cosines of cones on old axes and towards what is missing (n,), and (n, cones) what each sends where."""
    directions, light = sphere(len(missing)), np.maximum(missing, 0)
    axes = [light @ directions, directions[light.argmax()], *directions[::len(directions) // AXES]]
    axes = [axis / max(np.linalg.norm(axis), 1e-30) for axis in axes] + [axis for axis, _ in chosen if axis.any()]
    candidates, sent = [(np.zeros(3), (0.0, 0.0))], [np.ones(len(directions))]
    for axis in axes:
        cosine = directions @ axis
        for outer in np.cos(WIDTHS):
            for soft in SOFTNESS:
                candidates.append((axis, (float(outer), float(outer + (1 - outer) * soft))))
                sent.append(beam_share(cosine, candidates[-1][1]))
    return candidates, np.stack(sent, axis=1)


def _strengths(beams: np.ndarray, light: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(k, 3) >= 0 of least squares (multiplicative updates, Lee and Seung 2001)."""
    weighted = beams * weight[:, None]
    target, gram = weighted.T @ light, weighted.T @ beams
    strength = np.ones((beams.shape[1], 3)) * light.mean(axis=0)
    for _ in range(ROUNDS):
        strength *= target / np.maximum(gram @ strength, 1e-30)
    return strength
