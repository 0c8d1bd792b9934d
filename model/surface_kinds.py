# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of surfaces: which of them block light, let it pass, bend it, shine, or are seen by cameras; kinds of rays."""
from __future__ import annotations

from enum import IntFlag, auto

import numpy as np

from .scene import BASE_COLOR, TRANSPARENT, RenderScene, passing, tile_tints

BLACK = 1e-3         # base colour up to which a surface that no camera sees is the back of a lamp
THIN = 0.03          # share of light up to which none passes straight


class Ray(IntFlag):
    """What a ray is for, as Blender's Ray Visibility and its Light Path node tell them apart."""

    CAMERA = auto()
    DIFFUSE = auto()
    GLOSSY = auto()
    TRANSMISSION = auto()
    SHADOW = auto()
    SCATTER = auto()  # in a volume


BOUNCED = Ray.DIFFUSE | Ray.GLOSSY | Ray.TRANSMISSION


class Kind(IntFlag):
    """What a triangle is, which is one of these. Sets of them are what a ray can meet."""

    OPAQUE = auto()
    GLASS = auto()          # bends light
    CUTOUT = auto()         # lets light pass straight, such as leaves cut out by alpha
    EMITTER = auto()        # a surface that shines
    FLAME = auto()          # likewise, and lets light pass straight
    LAMP = auto()           # shines, and is not seen by cameras
    UNSEEN = auto()         # as OPAQUE, but not seen by cameras
    UNSEEN_GLASS = auto()
    UNSEEN_CUTOUT = auto()
    BACK = auto()           # black backs of lamps, for the network alone


ALL = ~Kind(0)
SEEN = Kind.OPAQUE | Kind.GLASS | Kind.CUTOUT | Kind.EMITTER | Kind.FLAME  # by cameras
BENDING = Kind.GLASS | Kind.UNSEEN_GLASS
SOLID = Kind.OPAQUE | Kind.UNSEEN                                # light ends there
OCCLUDING = SOLID | BENDING                                      # no light passes straight; lamps shade nothing
SHADING = OCCLUDING | Kind.EMITTER                               # what stops light that comes from elsewhere
STRAIGHT_THROUGH = Kind.CUTOUT | Kind.UNSEEN_CUTOUT
REFLECTING = SOLID | BENDING | STRAIGHT_THROUGH | Kind.EMITTER


def token_kinds(scene: RenderScene) -> np.ndarray:
    """(N,) i32, the Kind of each token triangle."""
    mostly, is_clear = (of_tiles[scene.tile_index] for of_tiles in (
        passing(scene.tiles) > TRANSPARENT, clear_tiles(scene).any(axis=1)))
    black = (scene.tiles[:, BASE_COLOR].max(axis=(1, 2, 3), initial=0) < BLACK)[scene.tile_index]
    is_seen, is_light = scene.is_seen, scene.is_light
    cases = ((is_light & is_seen & is_clear & mostly, Kind.FLAME),
             (is_light & is_seen, Kind.EMITTER), (is_light, Kind.LAMP),
             (is_clear & is_seen, Kind.CUTOUT), (mostly & is_seen, Kind.GLASS), (is_seen, Kind.OPAQUE),
             (mostly & ~is_clear, Kind.UNSEEN_GLASS), (black, Kind.BACK), (is_clear, Kind.UNSEEN_CUTOUT))
    return np.select([case for case, _ in cases], [int(kind) for _, kind in cases], int(Kind.UNSEEN)).astype(np.int32)


def clear_tiles(scene: RenderScene) -> np.ndarray:
    """(T, 3) share of each colour that passes tiles straight; 0 where that is next to nothing, or more is bent."""
    clear = scene.tile_clear
    share = clear.mean(axis=1)
    rows = np.flatnonzero(share > THIN)
    rows = rows[share[rows] > tile_tints(scene.tiles[rows]).mean(axis=1) / 2]
    result = np.zeros_like(clear)
    result[rows] = clear[rows]
    return result


def is_kind(kinds: np.ndarray, kind: Kind) -> np.ndarray:
    """(N,) bool: which of kinds (N,) are in a set."""
    return (kinds & int(kind)) != 0
