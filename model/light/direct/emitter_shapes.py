# SPDX-License-Identifier: GPL-3.0-or-later
"""Emitters as surfaces see them, with nothing in the way: directions, form factors and shares of glossy lobes.

Shapes: P points, E emitters (polygons first, then spheres). All lengths are in network units. Vectors to emitters are
planes (3, P, E), as in form_factors.py.
"""
from __future__ import annotations

import copy
import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...first_hits.camera_rays import SAMPLES
from ..sampling import R2, disk_points, local_basis, triangle_weights
from ..vectors import dot, unit
from .emitter_clusters import Emitters
from .emitters import DISTANT, ROUND
from .footprints import mirrored_turn2, points_within
from .form_factors import (
    MOST_SINE2,
    beam,
    cosines,
    polygon_directions,
    sphere_directions,
    sphere_form_factor,
)
from .glossy_lobe import emitter_share, facet_cosines, facet_width2, is_small, small_emitter_share
from .horizon import lambert_vector
from .outlines import CIRCLE, RING, fans, outline_vectors, ring_points, rings

# Squared turn of what a pixel mirrors over that of what facets do, from which on it is sampled finely; and squared size
# of an emitter over the same turn, up to which
FINE, LARGE = 1.0, 100.0
BENEATH = -0.3   # cosine to the middle of a round body, at most, of points on it
PAIRS = 1 << 14  # of points and emitters, whose outlines are integrated over at a time
LONG = 5.0         # times that a side of an emitter is longer than another, from which on it is as it is seen
LEAST_COSINE = 1e-3  # of light that leaves or meets a surface
IN_PLANE = 1e-3    # network units above the plane of a point up to which a polygon lies in it
LARGE_SINE2 = 3e-3  # of a polygon, from which on what the horizon leaves of it is exact
# Fields of EmitterShapes that have a row for each emitter.
OF_POLYGONS, OF_SPHERES = ("corners", "rings", "_points", "_is_long", "_fan"), ("centers", "radii", "_beyond2")
OF_ALL = ("origins", "_normals", "reach", "is_distant", "beam_axis", "beam_cosine", "outward", "is_surface")


class EmitterShapes:
    """Where emitters are, which ways they shine, and how large they look.

    origins (E, 3): their middles; reach (E,): of their farthest corner from there; is_distant (E,) bool: light of such,
    suns, is parallel; beam_axis, beam_cosine: as of Emitters; outward (E, 3): as there, zeros for spheres; is_surface
    (E,) bool: a mesh shines, no lamp; is_soft (E,) bool: a ball is as large as a disk that faces each place.
    """

    def __init__(self, emitters: Emitters, is_surface: np.ndarray, is_soft: np.ndarray,
                 device: torch.device | str):
        to_tensor = lambda x: torch.as_tensor(x, dtype=torch.float32, device=device)  # noqa: E731
        self.corners, self.centers, self.radii = map(to_tensor, (emitters.corners, emitters.centers, emitters.radii))
        self._beyond2 = self.radii.square() * to_tensor(is_soft[len(emitters.corners):])
        self.rings = to_tensor(rings(emitters.corners))
        points = self._points = ring_points(self.rings)
        edges = self.rings[..., 3:6].norm(dim=-1)
        self._is_long = edges.amax(1) > LONG * edges.amin(1)
        self._fan = to_tensor(fans(emitters.corners))
        self._normals = F.pad(unit(to_tensor(outline_vectors(emitters.corners))), (0, 0, 0, len(emitters.radii)))
        self.origins = torch.cat([points.mean(1), self.centers])
        self.reach = torch.cat([(points - points.mean(1, keepdim=True)).norm(dim=-1).amax(1), self.radii])
        self.is_distant = self.origins.norm(dim=-1) > DISTANT
        self.beam_axis, self.beam_cosine = map(to_tensor, (emitters.beam_axis, emitters.beam_cosine))
        self.outward = F.pad(to_tensor(emitters.outward), (0, 0, 0, len(emitters.radii)))
        self.is_surface = torch.as_tensor(is_surface, device=device)
        self._has_bodies = bool(is_surface[len(emitters.corners):].any())

    def __len__(self) -> int:
        return len(self.origins)

    def alone(self, row: int) -> EmitterShapes:
        """One emitter."""
        one, polygons = copy.copy(self), len(self.corners)
        own, of_spheres = slice(row, row + 1), slice(max(row - polygons, 0), max(row - polygons + 1, 0))
        for names, rows in ((OF_POLYGONS, own), (OF_SPHERES, of_spheres), (OF_ALL, own)):
            for name in names:
                setattr(one, name, getattr(self, name)[rows])
        return one

    def directions(self, x: Tensor, n: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Unit direction (3, P, E) to every emitter, its squared angular sine and its beam's share of radiance.

        With unit normals n (P, 3) none of a polygon in whose plane a point lies, and of a round body on which it lies:
        the sphere that stands for that is above some of its faces.
        """
        points, polygons = x, len(self.corners)
        x = x.T[..., None] * ~self.is_distant  # light of suns is parallel
        of_polygons = polygon_directions(self.corners, x[..., :polygons])
        of_spheres = sphere_directions(self.centers, self.radii, self._beyond2, x[..., polygons:])
        direction, sine2 = (torch.cat(both, -1) for both in zip(of_polygons, of_spheres, strict=True))
        in_beam = beam(direction, sine2, self.beam_axis, self.beam_cosine)
        if n is not None and polygons:
            in_beam[:, :polygons] *= self._heights(points, n)[1] > IN_PLANE
        if n is not None and self._has_bodies:
            is_near = self.is_surface[polygons:] & (sine2[:, polygons:] > ROUND ** -2)
            in_beam[:, polygons:] *= ~(is_near & (cosines(direction[..., polygons:], n) < BENEATH))
        return direction, sine2.clamp(0, MOST_SINE2), in_beam

    def form_factors(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """Unit direction (3, P, E) to every emitter, and the share of its radiance that a diffuse surface sends on."""
        direction, sine2, in_beam = self.directions(x, n)
        return direction, self.form_factor(x, n, cosines(direction, n), sine2) * in_beam

    def form_factor(self, x: Tensor, n: Tensor, cosine: Tensor, sine2: Tensor) -> Tensor:
        """(P, E) share of the emitters' light that a diffuse surface sends on, by cosines to and squared sines of them.

        Polygons that the horizon cuts count as spheres of their solid angle where they are small.
        """
        polygons = len(self.corners)
        lowest, highest = self._heights(x, n)
        form_factor = sphere_form_factor(cosine, sine2)
        whole = cosine[:, :polygons].clamp_min(0) * sine2[:, :polygons]
        of_polygons = torch.where(lowest >= 0, whole, form_factor[:, :polygons])
        cut = (lowest < 0) & (highest > 0) & (sine2[:, :polygons] > LARGE_SINE2)
        point, emitter = cut.nonzero().unbind(1)
        for some, of_some in zip(point.split(PAIRS), emitter.split(PAIRS), strict=True):
            basis = local_basis(n[some])
            ring = unit(torch.einsum("rij,kjr->kir", basis, self._outlines(x[some], of_some)), 1)
            of_polygons[some, of_some] = lambert_vector(ring)[2].abs() / (2 * math.pi)
        return torch.cat([of_polygons, form_factor[:, polygons:]], 1)

    def _heights(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """(P, E) of the lowest and the highest corner of polygons, above the planes of points with unit normals."""
        height = (n @ self.corners.flatten(0, 1).T).unflatten(1, self.corners.shape[:2])
        ground = dot(x, n)[:, None] * ~self.is_distant[:len(self.corners)]
        return height.amin(2) - ground, height.amax(2) - ground

    def glossy(self, x: Tensor, n: Tensor, direction: Tensor, sine2: Tensor, v: Tensor, roughness: Tensor,
               f0: Tensor, footprint: Tensor | None = None) -> Tensor:
        """(P, E) share of the emitters' radiance that a white glossy lobe sends on; directions as of `directions`."""
        facets = facet_cosines(direction, n, v)
        share = small_emitter_share(facets, sine2, roughness, f0)
        to_emitter = self.origins.T[:, None] - x.T[..., None] * ~self.is_distant
        distance2 = dot(to_emitter, to_emitter, 0)
        size2 = self.reach.square() / distance2.clamp_min(1e-20)
        if footprint is None:
            is_exact = ~is_small(facets, size2, roughness)
            return self._with_exact(share, is_exact & (sine2 > 0), x, n, v, roughness, f0)
        turn2 = mirrored_turn2(footprint)[:, None]
        is_exact = ~is_small(facets, size2 + turn2, roughness) & (sine2 > 0)
        is_finer = (turn2 > FINE * facet_width2(roughness)[:, None]) & (size2 < LARGE * turn2)
        share = self._with_exact(share, is_exact & ~is_finer, x, n, v, roughness, f0)
        return self._with_exact(share, is_exact & is_finer, x, n, v, roughness, f0, footprint)

    def _with_exact(self, share: Tensor, where: Tensor, *points: Tensor) -> Tensor:
        """`share` (P, E) with that of whole outlines `where` (P, E); points: x, n, v, roughness, f0, or footprints too,
        in which the mean is taken."""
        pairs = where.nonzero()
        if not len(pairs):
            return share
        size = PAIRS if len(points) == 5 else PAIRS // SAMPLES
        exact = [self._mean_share(emitter, *(values[point] for values in points))
                 for point, emitter in (some.unbind(1) for some in pairs.split(size))]
        return share.index_put(pairs.unbind(1), torch.cat(exact))

    def _mean_share(self, emitter: Tensor, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor,
                    footprint: Tensor | None = None) -> Tensor:
        """(R,) of pairs."""
        if footprint is None:
            return emitter_share(self._outlines(x, emitter), n.T, v.T, roughness, f0)
        within = torch.cat([x, n, v], 1) + points_within(footprint)  # all points at once, for pairs are few
        x, n, v = within.flatten(0, 1).split(3, 1)
        emitter, roughness, f0 = (values.repeat(len(within)) for values in (emitter, roughness, f0))
        return emitter_share(self._outlines(x, emitter), unit(n).T, unit(v).T, roughness, f0).unflatten(
            0, within.shape[:2]).mean(0)

    def _outlines(self, x: Tensor, emitter: Tensor) -> Tensor:
        """(RING, 3, R) vectors from points (R, 3) to the outlines of emitters (R,)."""
        origin = x * ~self.is_distant[emitter, None]
        polygons = len(self.corners)
        vectors = torch.zeros(len(x), RING, 3, device=x.device)
        if polygons:
            polygon = emitter.clamp(max=polygons - 1)
            vectors = self._points[polygon] - origin[:, None]
            long = self._is_long[polygon].nonzero()[:, 0]
            vectors[long] = _as_seen(self.rings[polygon[long]], origin[long, None])
        radius, beyond2 = (F.pad(values, (polygons, 0))[emitter] for values in (self.radii, self._beyond2))
        sphere = self.origins[emitter] - origin
        across = radius / (dot(sphere, sphere) + beyond2 - radius.square()).clamp_min(1e-12).sqrt()
        towards = unit(sphere)
        around = torch.from_numpy(CIRCLE).to(x.device) @ local_basis(towards)[:, :2]
        of_sphere = towards[:, None] + across[:, None, None] * around
        return torch.where((emitter < polygons)[:, None, None], vectors, of_sphere).permute(1, 2, 0).contiguous()

    def met_by(self, origin: Tensor, ray: Tensor, shines: Tensor) -> tuple[Tensor, Tensor]:
        """Of rays (R, 3) with unit vectors, the nearest polygon in their way that is no sun, -1 where none is, and how
        far it is, (R,) each. shines: (E,) bool, those that count; their backs do not."""
        polygons = len(self.corners)
        result = torch.full_like(ray[:, 0], -1, dtype=torch.long), torch.full_like(ray[:, 0], torch.inf)
        if not polygons or not len(ray):
            return result
        corners, axis = self.corners, self.beam_axis[:polygons]
        around = corners - corners[:, :1]
        normal = torch.linalg.cross(around, around.roll(-1, 1)).sum(1)
        normal = normal / normal.norm(dim=1, keepdim=True).clamp_min(1e-20)
        sinking = ray @ normal.T
        distance = (dot(corners[:, 0], normal) - origin @ normal.T) / sinking
        from_front = (ray @ axis.T < 0) | ~axis.any(1)
        is_near = from_front & (distance > IN_PLANE) & shines[:polygons] & ~self.is_distant[:polygons]
        row, polygon = is_near.nonzero().unbind(1)
        at = (origin[row] + ray[row] * distance[row, polygon, None])[:, None] - corners[polygon]
        sides = torch.linalg.cross(corners.roll(-1, 1)[polygon] - corners[polygon], at)
        is_within = (dot(sides, normal[polygon, None]) >= 0).all(1)
        distance = torch.full_like(distance, torch.inf).index_put(
            (row[is_within], polygon[is_within]), distance[row[is_within], polygon[is_within]])
        nearest, polygon = distance.min(1)
        return torch.where(nearest < torch.inf, polygon, -1), nearest

    def points_on(self, emitter: Tensor, direction: Tensor, start: Tensor) -> Tensor:
        """(R, 3) points on emitters (R,); on spheres those of the disk that faces unit vectors (R, 3).

        start: (R, 2) in [0, 1).
        """
        u, v = ((start[:, i] + emitter * step) % 1 for i, step in enumerate(R2))
        polygons = len(self.corners)
        on_disk = disk_points(direction, u, v) * F.pad(self.radii, (polygons, 0))[emitter, None]
        if not polygons:
            return self.origins[emitter] + on_disk
        on_polygon = self._points_on_polygons(emitter.clamp(max=polygons - 1), u, v)
        return torch.where((emitter < polygons)[:, None], on_polygon, self.origins[emitter] + on_disk)

    def falloff(self, emitter: Tensor, ray: Tensor) -> Tensor:
        """(R,) light along vectors (R, 3) to a place on emitters (R,), relative to other places on it."""
        length2 = dot(ray, ray).clamp_min(1e-18)
        facing = dot(self._normals[emitter], ray).abs() * length2.rsqrt()
        return facing.clamp_min(LEAST_COSINE).where(emitter < len(self.corners), 1.0) / length2

    def _points_on_polygons(self, polygon: Tensor, u: Tensor, v: Tensor) -> Tensor:
        """(R, 3) points that cover polygons (R,) evenly for u, v (R,) in [0, 1): triangles around corner 0 by area."""
        fan = self._fan[polygon]
        triangle = (fan[:, 1:-1] <= u[:, None]).sum(1, keepdim=True)
        first, last = (fan.gather(1, triangle + i)[:, 0] for i in (0, 1))
        corners = self.corners[polygon[:, None], F.pad(triangle + torch.tensor([1, 2], device=u.device), (1, 0))]
        share = ((u - first) / (last - first).clamp_min(1e-12)).clamp(0, 1)
        return (corners * triangle_weights(share, v)[..., None]).sum(1)


def _as_seen(ring: Tensor, x: Tensor) -> Tensor:
    """(R, K, 3) vectors from points x (R, 1, 3) to those of rings (R, K, 7), spread by angle over each edge.

    Spread by length, those of a long lamp would be far apart where it is close.
    """
    start, edge, before = ring.split([3, 3, 1], -1)
    start = start - x
    length2 = dot(edge, edge)[..., None].clamp_min(1e-12)
    closest = -dot(start, edge)[..., None] / length2
    beside = (dot(start, start)[..., None] / length2 - closest.square()).clamp_min(1e-6).sqrt()
    first, last = (torch.atan((end - closest) / beside) for end in (0, 1))
    return start + edge * (closest + beside * torch.lerp(first, last, before).tan()).clamp(0, 1)
