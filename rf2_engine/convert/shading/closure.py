# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted sums of BSDFs as the parameters of one BSDF (docs/scene-input.md 3.2, 3.3).

The network knows one surface: Principled with Specular IOR Level 1 (base colour, metallic, roughness, index of
refraction, transmission). Every closure is written as such parameters with a weight, and Mix and Add sum them.
"""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ....model.geometry import LEAST_IOR
from ....model.pictures import LUMINANCE
from ....model.scene import tint_of_glass
from ....model.surface_kinds import TRANSPARENT
from ..data.arrays import join
from .normal_map import UP

IOR_RANGE = (1.0, 2.5)  # the mappers' training range
GLASS_IOR = np.float32(1.06)  # least of glass: what lets light straight through, as Cycles' shadow rays pass, has less
TINY = 1e-4
# Of a Closure; others have 1.
CHANNELS = {"color": 3, "normal": 3, "emission": 3, "clear": 3, "translucent": 3, "sheen": 4, "coat": 4}
BRIGHTEST = np.float32(100)  # colour of a surface, where a node divides by almost 0
ONE, ZERO = np.ones(1, np.float32), np.zeros(1, np.float32)
WHITE, BLACK = np.ones(3, np.float32), np.zeros(3, np.float32)


@dataclass
class Closure:
    """Weighted sums over lobes; `lobe` and `gloss` are the weights that metallic/transmission and roughness go by."""

    weight: np.ndarray = None        # (..., 1)
    color: np.ndarray = None         # (..., 3)
    lobe: np.ndarray = None          # (..., 1) by luminance, so that the brighter lobe decides what the surface is
    metallic: np.ndarray = None
    transmission: np.ndarray = None
    gloss: np.ndarray = None         # (..., 1) by mirror-like reflectance: a diffuse lobe has no roughness of its own
    roughness: np.ndarray = None
    ior: np.ndarray = None
    normal: np.ndarray = None        # (..., 3)
    emission: np.ndarray = None      # (..., 3) radiance
    clear: np.ndarray = None         # (..., 3) share of the light that goes straight through
    translucent: np.ndarray = None   # (..., 3) colour of what sends its light to the other side
    fibre: np.ndarray = None         # (..., 1) by luminance, of what hair scatters
    sheen: np.ndarray = None         # (..., 4) colour, its mean over views is in `color`; roughness by luminance
    guessed: np.ndarray = None       # (..., 1) by luminance, of lobes that have another shape
    single: np.ndarray = None        # (..., 1) by gloss, of what facets scatter once
    coat: np.ndarray = None          # (..., 4) weight; by it f0, roughness, and share in the roughness of the surface
    holdout: np.ndarray = None       # (..., 1) share that is cut out of the film

    def __post_init__(self):
        for f in fields(self):
            if getattr(self, f.name) is None:
                setattr(self, f.name, np.zeros(CHANNELS.get(f.name, 1), np.float32))

    def __add__(self, other: Closure) -> Closure:
        return Closure(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __mul__(self, factor) -> Closure:
        return Closure(*(getattr(self, f.name) * factor for f in fields(self)))


@dataclass
class SurfaceParameters:
    """What a tile holds; (1,) or (3,) where constant, (m, 32, 32, 1 or 3) where not."""

    base_color: np.ndarray
    metallic: np.ndarray
    roughness: np.ndarray
    ior: np.ndarray
    transmission: np.ndarray
    normal: np.ndarray
    emission: np.ndarray
    clear: np.ndarray
    translucent: np.ndarray
    fibre: np.ndarray
    sheen: np.ndarray
    coat: np.ndarray
    guessed: np.ndarray
    single: np.ndarray
    holdout: np.ndarray


def lobe(color, metallic=ZERO, roughness=ONE, ior=ONE, transmission=ZERO, normal=UP) -> Closure:
    """One BSDF of weight 1. As in Cycles it may reflect more than arrives."""
    color, roughness = np.clip(color, 0, BRIGHTEST), np.clip(roughness, 0, 1)
    share = color @ LUMINANCE[:, None] + TINY
    reflectance = ((ior - 1) / (ior + 1)) ** 2
    gloss = metallic + transmission + reflectance + TINY
    return Closure(ONE, color, share, share * metallic, share * transmission, gloss, gloss * roughness,
                   np.clip(ior, np.where(transmission > TRANSPARENT, LEAST_IOR, IOR_RANGE[0]), IOR_RANGE[1]), normal,
                   BLACK)


def guess(closure: Closure, share: np.ndarray = ONE) -> Closure:
    """The closure, a share (..., 1) of which has another shape than its lobe."""
    closure.guessed = closure.lobe * share
    return closure


def scattered_once(closure: Closure, node) -> Closure:
    """The closure of a node, whose facets do not light each other unless its distribution says so."""
    if node.distribution != "MULTI_GGX":
        closure.single = closure.gloss
    return closure


def with_sheen(closure: Closure, color, roughness) -> Closure:
    """A closure of weight 1, in whose `color` a sheen of this colour (..., 3) is already."""
    closure.sheen = joined(color, roughness * (color @ LUMINANCE[:, None]))
    return closure


def joined(*values: np.ndarray) -> np.ndarray:
    """Values (..., n), constant or not, side by side as f32."""
    return join(*values).astype(np.float32)


def window(color) -> Closure:
    """What lets light of this colour straight through: transmission of index 1, which bends nothing.

    Principled tints by the root of its base colour: the colour is squared.
    """
    closure = lobe(color ** 2, roughness=ZERO, transmission=ONE)
    closure.clear = np.clip(color, 0, 1)
    return closure


def parameters(closure: Closure) -> SurfaceParameters:
    """Divide the sums by their weights; a surface without any BSDF (a pure emitter) is black and matt."""
    def mean(total, weight, default):
        return np.where(weight > 0, total / np.where(weight > 0, weight, 1), default).astype(np.float32)

    ior, transmission = mean(closure.ior, closure.weight, 1.0), mean(closure.transmission, closure.lobe, 0.0)
    (sheen, sheen_roughness), (coat, of_coat) = np.split(closure.sheen, [3], -1), np.split(closure.coat, [1], -1)
    straight, tint = (x.mean(axis=-1, keepdims=True) for x in (closure.clear, tint_of_glass(closure.color)))
    is_glass = (transmission > TRANSPARENT) & (straight < tint / 2)
    diffuse = closure.color * mean(closure.lobe - closure.metallic - closure.transmission, closure.lobe, 0.0)
    return SurfaceParameters(
        base_color=np.clip(closure.color, 0, BRIGHTEST).astype(np.float32),
        metallic=mean(closure.metallic, closure.lobe, 0.0), roughness=mean(closure.roughness, closure.gloss, 1.0),
        ior=np.where(is_glass, _bending(ior), ior) if is_glass.any() else ior, transmission=transmission,
        normal=mean(closure.normal, closure.weight, UP), emission=np.maximum(closure.emission, 0).astype(np.float32),
        clear=closure.clear, translucent=mean(closure.translucent, diffuse, 0.0).clip(0, 1),
        fibre=mean(closure.fibre, closure.lobe, 0.0), holdout=closure.holdout,
        sheen=joined(sheen, mean(sheen_roughness, sheen @ LUMINANCE[:, None], 0.0)),
        coat=joined(coat, mean(of_coat, coat, 0.0)), guessed=mean(closure.guessed, closure.lobe, 0.0),
        single=mean(closure.single, closure.gloss, 0.0))


def _bending(ior: np.ndarray) -> np.ndarray:
    """IOR of glass, which is not so near 1 that light would pass it straight."""
    return np.where(ior < 1, ior.clip(max=1 / GLASS_IOR), ior.clip(GLASS_IOR))
