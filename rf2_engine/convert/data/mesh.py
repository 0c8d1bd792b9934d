# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes as triangle arrays (docs/scene-input.md 2), and what is computed of triangles."""
from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, wraps

import numpy as np

from ....model.geometry import area_vectors
from .report import AS_GOOD_AS_INFINITE

PIECE = 1 << 14  # triangles whose numbers fit into a processor's cache, which takes a fraction of the time


def in_pieces(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """A function of (n, ...) arrays that is the same for each row, a few rows at a time."""
    @wraps(function)
    def of_all(rows: np.ndarray) -> np.ndarray:
        if len(rows) <= PIECE:
            return function(rows)
        return np.concatenate([function(rows[start:start + PIECE]) for start in range(0, len(rows), PIECE)])

    return of_all


@dataclass
class TriangleMesh:
    """n triangles with everything that varies per corner, in the frame of the object (Z up, right-handed)."""

    corners: np.ndarray            # (n, 3, 3) f32, [triangle, corner, xyz], counter-clockwise from the front
    normals: np.ndarray            # (n, 3, 3) f32, unit shading normal per corner
    uv: dict[str, np.ndarray]      # layer -> (n, 3, 2) f32
    active_uv: str | None          # the layer that renders where a material names none
    attributes: dict[str, np.ndarray]  # by name (n, 3, c) f32, c from 1 to 4; colours are scene-linear, with alpha
    active_color: str | None       # the one that renders where a material names none
    slot: np.ndarray               # (n,) i32, material slot
    texture_space: np.ndarray      # (2, 3) f32, middle and half size of the box of Generated coordinates
    is_displaced: bool = False         # its materials' displacement is in the corners

    def __len__(self) -> int:
        return len(self.corners)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest coordinates."""
        flat = self.corners.reshape(-1, 9)
        return np.stack([flat.min(axis=0).reshape(3, 3).min(axis=0), flat.max(axis=0).reshape(3, 3).max(axis=0)])

    @cached_property
    def area(self) -> float:
        return float(areas(self.corners).sum())

    @cached_property
    def digest(self) -> bytes:
        """The same for meshes with equal triangles."""
        digest = hashlib.blake2b(digest_size=16)
        layers = {"corners": self.corners, "normals": self.normals, "slot": self.slot, "space": self.texture_space,
                  **{f"uv {name}": layer for name, layer in self.uv.items()},
                  **{f"attribute {name}": layer for name, layer in self.attributes.items()}}
        for name, values in layers.items():
            digest.update(f"{name}{values.shape}{values.dtype}".encode())
            digest.update(np.ascontiguousarray(values))
        digest.update(repr((self.active_uv, self.active_color, self.is_displaced)).encode())
        return digest.digest()

    def take(self, index: np.ndarray) -> TriangleMesh:
        """The triangles picked by an integer or boolean index."""
        return self.mapped(lambda layer: layer[index], slot=self.slot[index])

    def mirrored(self) -> TriangleMesh:
        """The same surface with the corner order reversed, for matrices with a negative determinant."""
        return self.mapped(lambda layer: layer[:, [1, 0, 2]])

    def mapped(self, function, **changes) -> TriangleMesh:
        """This mesh with `function` applied to every array that varies per corner."""
        return replace(self, corners=function(self.corners), normals=function(self.normals),
                       uv={name: function(layer) for name, layer in self.uv.items()},
                       attributes={name: function(layer) for name, layer in self.attributes.items()}, **changes)


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Meshes as one, in the frame and with the texture space of the first; layers that one lacks are 0 there."""
    join = np.concatenate
    return replace(meshes[0], corners=join([mesh.corners for mesh in meshes]),
                   normals=join([mesh.normals for mesh in meshes]), slot=join([mesh.slot for mesh in meshes]),
                   uv=_joined_layers([mesh.uv for mesh in meshes], meshes),
                   attributes=_joined_layers([mesh.attributes for mesh in meshes], meshes))


def _joined_layers(layers: list[dict[str, np.ndarray]], meshes: Sequence[TriangleMesh]) -> dict[str, np.ndarray]:
    """By name, what varies per corner, as wide as the widest."""
    widths: dict[str, int] = {}
    for of_mesh in layers:
        for name, values in of_mesh.items():
            widths[name] = max(widths.get(name, 0), values.shape[2])
    joined = {name: np.zeros((sum(map(len, meshes)), 3, width), np.float32) for name, width in widths.items()}
    begin = 0
    for of_mesh, mesh in zip(layers, meshes, strict=True):
        for name, values in of_mesh.items():
            joined[name][begin:begin + len(mesh), :, :values.shape[2]] = values
        begin += len(mesh)
    return joined


def transform(mesh: TriangleMesh, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World-space (n, 3, 3) f32 corners and unit normals of a mesh under a (4, 4) matrix.

    A mesh under a matrix with a negative determinant must have been `mirrored` before.
    """
    linear = matrix[:3, :3].astype(np.float64)
    a, b, c = linear.T
    # Columns of the cofactor matrix: the inverse transpose that also exists for a flattened object.
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    if np.linalg.det(linear) < 0:
        cofactor = -cofactor
    cofactor /= max(np.abs(cofactor).max(), 1e-300)  # the lengths of normals fit f32, which is twice as fast
    corners = mesh.corners.reshape(-1, 3) @ linear.T.astype(np.float32) + matrix[:3, 3].astype(np.float32)
    normals, corners = mesh.normals.reshape(-1, 3) @ cofactor.T.astype(np.float32), corners.reshape(-1, 3, 3)
    length = lengths(normals)
    normals = (normals / length.clip(1e-30)[:, None]).reshape(-1, 3, 3)
    unusable = (length < 1e-12).reshape(-1, 3)
    if unusable.any():
        row, corner = np.nonzero(unusable)
        normals[row, corner] = face_normals(corners[row])
    return corners, normals


@in_pieces
def face_normals(corners: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals of (n, 3, 3) corners; 0 for triangles without area."""
    normals = area_vectors(corners.astype(np.float64))
    return normals / np.maximum(lengths(normals)[:, None], 1e-300)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """(...) of (..., 3) vectors; numpy's own norm takes four times as long."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


@in_pieces
def middles(corners: np.ndarray) -> np.ndarray:
    """(n, 3) centroids of (n, 3, 3) corners."""
    return (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3


@in_pieces
def areas(corners: np.ndarray) -> np.ndarray:
    """(n,) f64 areas of (n, 3, 3) corners."""
    return lengths(area_vectors(corners.astype(np.float64)))


@in_pieces
def within_reach(corners: np.ndarray) -> np.ndarray:
    """(n,) bool: no coordinate of the triangle is NaN, or infinite, or as good as that."""
    return (np.abs(corners) < AS_GOOD_AS_INFINITE).all(axis=(1, 2))


@in_pieces
def has_area(corners: np.ndarray) -> np.ndarray:
    """(n,) bool: the triangle is not a line or a point at the precision of its own coordinates."""
    longest = np.square(longest_edges(corners))
    extent = np.abs(corners).max(axis=(1, 2)).astype(np.float64)
    return (areas(corners) > 1e-7 * longest) & (longest > np.square(1e-7 * extent)) & (longest > 1e-30)


@in_pieces
def longest_edges(corners: np.ndarray) -> np.ndarray:
    """(n,) f64 length of the longest edge of each triangle."""
    a, b, c = corners.astype(np.float64).swapaxes(0, 1)
    return np.maximum(np.maximum(lengths(b - a), lengths(c - b)), lengths(a - c))


def unit_or(vectors: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """`vectors` normalised along the last axis as f32; `fallback` where they are 0 or not finite."""
    vectors = vectors.astype(np.float64)
    length = lengths(vectors)[..., None]
    usable = np.isfinite(length) & (length > 1e-12 * np.nanmax(length, initial=1e-300))
    return np.where(usable, vectors / np.where(usable, length, 1), fallback).astype(np.float32)


@in_pieces
def corner_keys(corners: np.ndarray) -> np.ndarray:
    """(n, 3) u64 of (n, 3, 3) f32 corners, alike for equal coordinates, and for no others by any likely chance."""
    bits = np.ascontiguousarray(corners.astype(np.float32) + np.float32(0)).view(np.uint32)  # -0 and 0 are one
    key = np.zeros(bits.shape[:2], np.uint64)
    for axis in range(3):  # round coordinates differ in few bits, so these are mixed well (Steele et al. 2014)
        key = (key + bits[..., axis]) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ key >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
        key ^= key >> np.uint64(31)
    return key
