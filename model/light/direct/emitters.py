# SPDX-License-Identifier: GPL-3.0-or-later
"""Gather light triangles into a few emitters whose unshadowed light has a closed form."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...clusters import split_clusters
from ...geometry import area_vectors, surfaces, unit
from ...scene import RenderScene
from .emitter_clusters import NO_SHELL, Emitters, merged, triangle
from .outlines import convex_outline, cut
from .pictures import BUT_RADIANCE, CELLS, LIGHT, Picture, find_pictures

DISTANT = 15.0      # network units; an open surface beyond is a sun, which looks alike from everywhere
MAX_EMITTERS = 96   # of a scene, as many as eight disk lamps: time and memory of direct light grow with them
MAX_POLYGONS = 16   # triangles of one connected emitter that are kept one by one
MAX_LUMPS = 16      # what a larger one is merged into
NARROW = {4: 0.3, MAX_LUMPS: 0.97}  # cosines of the rim of a beam from which on a flat one is so many parts
MAX_AROUND = 64     # and one that surrounds what it lights
INSIDE = 0.5        # share of the scene's radius that is inside such a one at least
MAX_PARTS = 8       # that a closed one is divided into which is neither round nor straight
MAX_FACES = 6       # of a closed convex one that shines by each of them,
MOST_WITH_FACES = 48  # unless a scene would have more emitters then
LEAST_FACE = 0.01   # share of its area that a face has which is not left out, such as the ends of a strip,
THIN = 0.45         # share of the largest face in all of its area from which on it is as good as a sheet
SAME_FACE = 1e-4    # one minus the cosine between normals of a face,
BULGE = 1e-3        # and how far corners may be beyond one, in sizes of the body
CURVED = 0.3        # cosine between a lump's normal and its direction from the middle from which on it is of a shell
STRAIGHT = 1.5      # distance of corners from the axis in radii of a rod up to which it is straight
ROUND = 1.6         # distance of its farthest corner in radii of the sphere of its area up to which it is round
CLOSED = 0.3        # |vector area| / area below which a surface radiates like a sphere
FLAT = 1.5          # silhouette over that of a sphere of equal area from which on it radiates like a sheet; 2 at most


class Limits(NamedTuple):
    """Of the light of K kinds of emitters."""

    hidden: np.ndarray   # (K,) u8, rays that do not see them
    bounces: np.ndarray  # (K,) u8, most of its bounces
    groups: np.ndarray   # (K,) u64, of surfaces that it falls on
    blockers: np.ndarray  # (K,) u64, groups of surfaces that stop it
    is_lamp: np.ndarray  # (K,) bool, that no camera sees them: all others hide none of their light from each other
    is_soft: np.ndarray  # (K,) bool, that balls are disks that face each place

    @classmethod
    def of(cls, scene: RenderScene) -> tuple[Limits, np.ndarray]:
        """And the kind (L,) of each triangle that shines."""
        each = cls(scene.hidden_from, *map(scene.seldom, ("light_bounces", "lit_groups", "blockers")), ~scene.is_seen,
                   scene.seldom("softened") < 1)
        table = np.stack([values[scene.is_light].astype(np.uint64) for values in each], axis=1)
        rows, kind = np.unique(table, axis=0, return_inverse=True)
        return cls(*rows.T), kind.reshape(-1)


def gather_emitters(scene: RenderScene) -> Emitters:
    """Touching light triangles of equal radiance and beam as one: flat convex ones a polygon, lamps spheres, fine
    meshes a few lumps.

    A scene with more than MAX_EMITTERS of these, such as an emission texture makes, gets that many, and as much light.
    """
    rows = np.flatnonzero(scene.is_light)
    corners = scene.triangles[rows]
    kind = Limits.of(scene)[1][:, None]
    emission = scene.emission[rows] / scene.seldom("softened")[rows, None]
    light = np.concatenate([emission, scene.beam_axis[rows], scene.beam_cosine[rows], kind], axis=1)
    center, radius = _bounding_sphere(scene)
    pictures, rest, cells = _pictures(scene, light)
    emitters = _gathered(corners[rest], light[rest], center, radius, MAX_FACES)
    if len(emitters) + cells > MOST_WITH_FACES:
        emitters = _gathered(corners[rest], light[rest], center, radius)
    if len(emitters) + cells > MAX_EMITTERS:
        pictures, rest, cells = _pictures(scene, light, with_meshes=True)
        evened = _evened(corners[rest], light[rest], center)
        emitters = merged(_gathered(corners[rest], evened, center, radius), MAX_EMITTERS - cells, center, radius)
    return emitters.beside(pictures, cells // len(pictures), light) if pictures else emitters


def _pictures(scene: RenderScene, light: np.ndarray,
              with_meshes: bool = False) -> tuple[list[Picture], np.ndarray, int]:
    """As of find_pictures, (L,) bool, the triangles of none, and how many cells all of them have."""
    pictures = [picture for picture in find_pictures(scene, light, with_meshes)
                if np.linalg.norm(picture.outline.mean(axis=0)) <= DISTANT]
    rest = np.ones(len(light), bool)
    for picture in pictures:
        rest[picture.rows] = False
    return pictures, rest, len(pictures) * (CELLS // max(len(pictures), 1))


def _gathered(corners: np.ndarray, light: np.ndarray, center: np.ndarray, radius: float,
              most_faces: int = 0) -> Emitters:
    """Emitters of triangles (N, 3, 3) that shine with light (N, len(LIGHT)).

    center (3,), radius: sphere around what they light; most_faces: of a body that each become an emitter.
    """
    polygons, spheres = [], []
    for part in _components(corners, light):
        shape, own = corners[part], light[part[0]]
        vectors = area_vectors(shape)
        if not vectors.any():
            continue
        if not _is_closed(vectors):
            more = _of_open(shape, vectors, own)
        elif _surrounds(shape, vectors, center, radius):
            more = [(*piece, own) for piece in _pieces(shape, MAX_AROUND)], []
        else:
            more = _of_body(shape, vectors, own, most_faces)
        polygons += more[0]
        spheres += more[1]
    return Emitters.of(polygons, spheres)


def _of_open(shape: np.ndarray, vectors: np.ndarray, light: np.ndarray) -> tuple[list[tuple], list[tuple]]:
    """Polygons and spheres, as of Emitters.of, of an open surface (n, 3, 3) of these area vectors (n, 3)."""
    middle = shape.mean(axis=(0, 1))
    if np.linalg.norm(middle) > DISTANT:
        area = np.linalg.norm(vectors.sum(axis=0)) / np.pi
        return [], [(middle, np.sqrt(area / (1 + area / (middle @ middle))), light)]  # of the same solid angle
    pieces, rim = _pieces(shape), light[LIGHT["beam_cosine"]][0]
    count = max((parts for parts, cosine in NARROW.items() if light[LIGHT["beam_axis"]].any() and rim > cosine),
                default=0)
    if count:  # each point lights what is before it
        pieces = [(part, shell) for outline, shell in pieces for part in cut(outline, count // len(pieces))]
    return [(*piece, light) for piece in pieces], []


def _of_body(shape: np.ndarray, vectors: np.ndarray, light: np.ndarray,
             most_faces: int) -> tuple[list[tuple], list[tuple]]:
    """The same of a closed surface: its faces, a sheet, or spheres and rods."""
    exact = vectors.astype(np.float64)
    if not light[LIGHT["beam_axis"]].any() and (faces := _faces(shape, exact, most_faces)):
        return [(outline, NO_SHELL, np.concatenate([light[LIGHT["radiance"]], normal, [0, 0], light[LIGHT["kind"]]]))
                for outline, normal in faces], []
    if (sheet := _sheet(shape, exact)) is not None:
        front, gain = sheet
        light = light.copy()
        light[LIGHT["radiance"]] *= gain
        return [(*piece, light) for piece in _pieces(front)], []
    polygons, spheres = [], []
    for rows in _round_or_straight(shape, vectors):
        some = shape[rows], vectors[rows]
        if _is_round(*some):
            spheres.append((*_sphere(*some), light))
        else:
            polygons += [(rectangle, NO_SHELL, light) for rectangle in _rod(*some)]
    return polygons, spheres


def _is_closed(vectors: np.ndarray) -> bool:
    return np.linalg.norm(vectors.sum(axis=0)) < CLOSED * np.linalg.norm(vectors, axis=1).sum()


def _evened(corners: np.ndarray, light: np.ndarray, center: np.ndarray) -> np.ndarray:
    """`light` with the mean radiance on closed surfaces, so that these become spheres, unless `center` is inside."""
    light = light.copy()
    for part in _components(corners, light[:, BUT_RADIANCE]):
        vectors = area_vectors(corners[part])
        if _is_closed(vectors):
            middle, radius = _sphere(corners[part], vectors)
            if np.linalg.norm(middle - center) > radius:
                radiance = light[part, LIGHT["radiance"]]
                light[part, LIGHT["radiance"]] = np.average(radiance, axis=0, weights=np.linalg.norm(vectors, axis=1))
    return light


def _bounding_sphere(scene: RenderScene) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of what is lit: the scene without its lights."""
    points = scene.triangles[~scene.is_light if not scene.is_light.all() else slice(None)].reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-20)


def _components(corners: np.ndarray, kinds: np.ndarray) -> list[np.ndarray]:
    """Rows of triangles that share a corner position and have equal `kinds` (N, K)."""
    group = surfaces(corners, kinds)
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(group) else []


def _surrounds(shape: np.ndarray, vectors: np.ndarray, center: np.ndarray, radius: float) -> bool:
    """Whether a closed surface is around what it lights, as a dome, whose light comes from all sides."""
    middle, of_sphere = _sphere(shape, vectors)
    return np.linalg.norm(middle - center) + INSIDE * radius < of_sphere


def _pieces(shape: np.ndarray, most: int = MAX_LUMPS) -> list[tuple[np.ndarray, np.ndarray]]:
    """Polygons (K, 3) of a surface (n, 3, 3): one if it is flat, else its triangles or lumps. And as of
    Emitters.outward."""
    outline = convex_outline(shape)
    if outline is not None:
        return [(outline, NO_SHELL)]
    if len(shape) <= MAX_POLYGONS:
        return [(corners, NO_SHELL) for corners in shape]
    vectors, places = area_vectors(shape.astype(np.float64)), shape.mean(axis=1)
    known = np.concatenate([places / places.std(axis=0).max().clip(1e-20), unit(vectors)], axis=1)
    areas = np.linalg.norm(vectors, axis=1)
    middle = np.average(places, axis=0, weights=areas)
    lumps = []
    for rows in _parts(known, areas, most):
        vector, center = vectors[rows].sum(axis=0), np.average(places[rows], axis=0, weights=areas[rows] + 1e-20)
        normal, away = unit(vector), unit(center - middle)
        along = normal @ away
        lumps.append((triangle(vector, center), np.sign(along) * normal if abs(along) > CURVED else NO_SHELL))
    return lumps


def _faces(shape: np.ndarray, vectors: np.ndarray, most: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Outlines (K, 3) of the faces of a convex body (n, 3, 3), such as a cube, and their unit normals (3,), outwards.

    None of any other body, of one that has more of them, and of a thin one. Before a face all of it is seen.
    """
    areas = np.linalg.norm(vectors, axis=1)
    normals, points, faces = unit(vectors), shape.reshape(-1, 3).astype(np.float64), []
    left, middle, bulge = vectors.any(axis=1), points.mean(axis=0), BULGE * np.linalg.norm(np.ptp(points, axis=0))
    while left.any():
        normal = normals[left.argmax()]
        rows = left & (np.abs(normals @ normal) > 1 - SAME_FACE)
        rows &= np.abs((shape.mean(axis=1) - shape[left.argmax()].mean(axis=0)) @ normal) < bulge
        outline = convex_outline(shape[rows])
        if outline is None or len(faces) == most or areas[rows].sum() > THIN * areas.sum():
            return []
        normal = normal * np.sign((outline[0] - middle) @ normal)
        if ((points - outline[0]) @ normal).max() > bulge:
            return []
        if areas[rows].sum() > LEAST_FACE * areas.sum():
            faces.append((outline, normal))
        left &= ~rows
    return faces


def _round_or_straight(shape: np.ndarray, vectors: np.ndarray) -> list[np.ndarray]:
    """Rows of a closed surface (n, 3, 3): all of it if it is like a sphere or a rod, else those of its parts."""
    if _is_round(shape, vectors) or _is_straight(shape, vectors):
        return [np.arange(len(shape))]
    return _parts(shape.mean(axis=1), np.linalg.norm(vectors, axis=1), MAX_PARTS)


def _is_round(shape: np.ndarray, vectors: np.ndarray) -> bool:
    middle, radius = _sphere(shape, vectors)
    return np.linalg.norm(shape - middle, axis=-1).max() < ROUND * radius


def _is_straight(shape: np.ndarray, vectors: np.ndarray) -> bool:
    points, axes, radius = _along_axes(shape, vectors)
    return np.linalg.norm(points @ axes[:, 1:], axis=-1).max() < STRAIGHT * radius


def _rod(shape: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(3, 4, 3) rectangles through the axis of a long surface, as wide together as its silhouette is in the mean."""
    points, axes, radius = _along_axes(shape, vectors)
    along = points @ axes[:, 0]
    turns = np.pi / 3 * np.arange(3)
    sides = np.pi / 6 * radius * np.stack([np.cos(turns), np.sin(turns)], axis=1) @ axes[:, 1:].T
    low, high = _sphere(shape, vectors)[0] + np.outer((along.min(), along.max()), axes[:, 0])
    return np.stack([low - sides, low + sides, high + sides, high - sides], axis=1)


def _along_axes(shape: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(3 n, 3) corners from the middle, (3, 3) principal axes in columns, the longest first, and the radius of a
    cylinder of the same length and area."""
    middle, of_sphere = _sphere(shape, vectors)
    points = shape.reshape(-1, 3).astype(np.float64) - middle
    axes = np.linalg.eigh(points.T @ points)[1][:, ::-1]
    return points, axes, 2 * of_sphere ** 2 / max(np.ptp(points @ axes[:, 0]), 1e-20)


def _parts(points: np.ndarray, areas: np.ndarray, most: int) -> list[np.ndarray]:
    """Rows of at most so many parts of a surface of areas (n,), alike in points (n, K)."""
    return split_clusters(points, areas, [np.arange(len(points))], most)


def _sphere(shape: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the sphere of the same area."""
    weights = np.linalg.norm(vectors, axis=1)
    return np.average(shape.mean(axis=1), axis=0, weights=weights), float(np.sqrt(weights.sum() / (4 * np.pi)))


def _sheet(shape: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Half of a flat closed surface, moved into its middle, and the gain with which it gives the light of the whole.

    None if the surface is not flat.
    """
    areas = np.linalg.norm(vectors, axis=1)
    _, axes = np.linalg.eigh(vectors.T @ (vectors / np.maximum(areas, 1e-30)[:, None]))
    axis = axes[:, -1]
    silhouette = np.abs(vectors @ axis).sum() / 2
    if silhouette < FLAT * areas.sum() / 4:
        return None
    front = vectors @ axis > 0.5 * areas
    heights = shape.mean(axis=1) @ axis
    sink = np.average(heights[front], weights=areas[front]) - np.average(heights, weights=areas)
    return shape[front] - (sink * axis).astype(np.float32), areas.sum() / (2 * areas[front].sum())
