# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky behind glass, as gather rays see it. Light of emitters, which glass focuses, is in caustics/photons.py."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...geometry import area_vectors, unit
from ...progress import part
from ...scene import IOR, ROUGHNESS, RenderScene, tile_means, tile_tints
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, Ray
from ..bounding_sphere import BoundingSphere
from ..cutouts import GAP
from ..direct.environment_light import BLUR, LIFT, EnvironmentLight
from ..tensor_rays import TensorRays
from ..vectors import dot

SURFACES = 4          # of glass that dim a ray
ENTERING, LEAVING, THROUGH_BACK = range(3)
# Share of light from everywhere that passes white glass, by roughness and IOR, as blurred as Cycles has it behind a
# diffuse bounce (Filter Glossy 1; measured there): into it through its front, out of it through its back, and through a
# solid pane. An IOR of 1 is stored as the first of these (rf2_engine/convert/shading/closure.py).
ROUGHNESSES = 0.2, 0.4, 0.6, 0.8, 1.0
IORS = 1.06, 1.07, 1.1, 1.2, 1.33, 1.45, 1.7, 2.0, 2.5
INTO, OUT, THROUGH = np.float32([
    [[0.985, 0.931, 0.931, 0.926, 0.914, 0.900, 0.869, 0.830, 0.766],
     [0.985, 0.943, 0.942, 0.937, 0.925, 0.911, 0.881, 0.843, 0.779],
     [0.985, 0.976, 0.974, 0.967, 0.955, 0.942, 0.913, 0.878, 0.817],
     [0.985, 0.998, 0.996, 0.989, 0.979, 0.969, 0.945, 0.915, 0.863],
     [0.985, 1.000, 0.997, 0.994, 0.986, 0.978, 0.960, 0.935, 0.894]],
    [[0.985, 0.828, 0.785, 0.664, 0.535, 0.447, 0.319, 0.225, 0.140],
     [0.985, 0.862, 0.820, 0.697, 0.562, 0.470, 0.335, 0.236, 0.146],
     [0.985, 0.932, 0.899, 0.786, 0.648, 0.548, 0.396, 0.280, 0.173],
     [0.985, 0.973, 0.954, 0.868, 0.756, 0.659, 0.496, 0.357, 0.219],
     [0.985, 0.989, 0.977, 0.923, 0.847, 0.770, 0.608, 0.450, 0.288]],
    [[0.970, 0.800, 0.771, 0.701, 0.604, 0.535, 0.419, 0.318, 0.194],
     [0.970, 0.835, 0.807, 0.733, 0.650, 0.581, 0.454, 0.347, 0.214],
     [0.970, 0.927, 0.906, 0.851, 0.784, 0.715, 0.581, 0.463, 0.306],
     [0.970, 0.978, 0.960, 0.895, 0.875, 0.827, 0.627, 0.509, 0.392],
     [0.970, 0.986, 0.967, 0.928, 0.881, 0.787, 0.654, 0.571, 0.488]]])
# Measured there too: how optical depth grows with 1 minus the cosine, up to the first and by the second number; what
# of it is left straight on, the less the clearer glass is.
SLANTING, STRAIGHT = (0.58, 1.77), 0.5
MIRRORED = 0.26       # of the light that does not pass a pane, what it sends back, measured in a room with a window
WITHIN = 0.63         # the same of a surface that light meets from within, such as that of water, in a basin
GREY = 0.01           # difference between colours of a tint up to which it is grey


class BehindGlass(NamedTuple):
    """What M of N rays that hit glass see behind it, and K of these, which see the sky, mirrored by it."""

    ray: Tensor            # (M,) of the N
    sky: Tensor            # (M, 3) radiance of the sky that arrives through the glass
    transmittance: Tensor  # (M, 3)
    mirroring: Tensor      # (K,) of the N
    begin: Tensor          # (K, 3), where they go on mirrored,
    onward: Tensor         # (K, 3) along these unit vectors
    mirrored: Tensor       # (K, 1) share of the radiance from there


class Panes:
    """All glass of a scene."""

    def __init__(self, scene: RenderScene, environment: EnvironmentLight | None, device: torch.device):
        rays = scene_rays(scene)
        self.environment, self.surfaces = environment, TensorRays(rays.among(BENDING, Ray.DIFFUSE))
        self._around = BoundingSphere.of(scene.surfaces.triangles[rays.rows(BENDING, Ray.DIFFUSE)], device)
        tint = tile_tints(scene.tiles)[scene.tile_index]
        of_glass = tint[scene.surfaces.token[rays.rows(BENDING, Ray.DIFFUSE)]]
        self.have_colors = bool((np.ptp(of_glass, axis=1) > GREY).any())
        normal = unit(area_vectors(scene.surfaces.triangles)).astype(np.float32)
        self._tint, self._token, self._normal, self._transmittance = (torch.from_numpy(x).to(device) for x in (
            tint, scene.surfaces.token, normal, token_transmittances(scene)))

    def behind(self, origin: Tensor, direction: Tensor, distance: Tensor) -> BehindGlass:
        """Of N rays, which hit glass within their distances (N,), infinite for those that hit nothing else."""
        ray = self._around.is_near(origin, direction, distance).nonzero()[:, 0]  # waits for a GPU
        with part(0.0, 1 / SURFACES):
            hit, pane, travelled = self._next_pane(origin[ray], direction[ray], 0.0, distance[ray])
        ray = ray[hit]
        origin, direction, distance = (x[ray] for x in (origin, direction, distance))
        transmittance, passed = self._transmittances(origin, direction, distance, pane, travelled)
        light, to_sky = torch.zeros_like(direction), distance.isinf()
        if self.environment is not None:
            sky = self.environment.filtered(direction, torch.full_like(direction[:, 0], BLUR))
            light = transmittance * sky * to_sky[:, None]
        cosine = dot(self._normal[pane], direction)
        facing = -cosine.sign()[:, None] * self._normal[pane]
        begin = origin + travelled * direction + LIFT * facing
        onward = direction - 2 * dot(direction, facing)[:, None] * facing
        mirrored = torch.where((cosine > 0)[:, None], WITHIN, MIRRORED) * (1 - passed)
        mirroring = to_sky.nonzero()[:, 0]  # waits for a GPU
        return BehindGlass(ray, light, transmittance, *(x[mirroring] for x in (ray, begin, onward, mirrored)))

    def _next_pane(self, origin: Tensor, direction: Tensor, travelled: Tensor | float,
                   distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Of R rays that have travelled so far (R, 1), those that hit glass within their distances (R,): their rows,
        the triangles, and how far they have travelled then (H, 1)."""
        begin = travelled + GAP
        pane, step, _ = self.surfaces.nearest(origin + begin * direction, direction)
        travelled = begin + step[:, None]
        hit = ((pane >= 0) & (travelled[:, 0] < distance)).nonzero()[:, 0]  # waits for a GPU
        return hit, pane[hit], travelled[hit]

    def _transmittances(self, origin: Tensor, direction: Tensor, distance: Tensor, pane: Tensor,
                        travelled: Tensor) -> tuple[Tensor, Tensor]:
        """Share of light that passes all glass on M rays, (M, 3), and without its tints, (M, 1).

        pane: (M,) triangles where they meet the first, which is as far (M, 1) as they have travelled.
        """
        transmittance, passed = torch.ones_like(direction), torch.ones_like(direction[:, :1])
        row, is_inside = torch.arange(len(pane), device=pane.device), torch.zeros_like(pane, dtype=torch.bool)
        for surface in range(1, SURFACES + 1):
            cosine, token = dot(self._normal[pane], direction[row]), self._token[pane]
            leaves = cosine > 0
            case = torch.where(leaves, torch.where(is_inside[row], THROUGH_BACK, LEAVING), ENTERING)
            passes = transmittance_at(cosine.abs(), self._transmittance[token, case])
            transmittance[row] *= passes[:, None] * self._tint[token]
            passed[row] *= passes[:, None]
            is_inside[row] = ~leaves
            if surface < SURFACES:
                with part(surface / SURFACES, (surface + 1) / SURFACES):
                    hit, pane, travelled = self._next_pane(origin[row], direction[row], travelled, distance[row])
                row = row[hit]
        return transmittance, passed


def token_transmittances(scene: RenderScene) -> np.ndarray:
    """(N, 3) f32 share of light that passes glass of each token triangle, besides its tint.

    Where it is entered, left without having been entered, and left after that.
    """
    means = tile_means(scene.tiles[:, (IOR, ROUGHNESS)])
    into, out, through = (_interpolated(table, *means.T) for table in (INTO, OUT, THROUGH))
    return np.stack([into, out, through / into], axis=1)[scene.tile_index]


def transmittance_at(cosine: Tensor, mean: Tensor) -> Tensor:
    """(M,) share of light that passes glass at cosines (M,) to its normal, by that of light from everywhere (M,)."""
    depth = -mean.log()
    slant = ((1 - cosine) / SLANTING[0]).clamp(max=1)
    return (-depth * torch.lerp(depth / (depth + STRAIGHT), torch.full_like(depth, SLANTING[1]), slant)).exp()


def _interpolated(table: np.ndarray, ior: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """(T,) of a table by ROUGHNESSES and IORS."""
    by_ior = np.stack([np.interp(ior, IORS, row) for row in table], axis=1)
    at = np.interp(roughness, ROUGHNESSES, range(len(ROUGHNESSES)))
    low = at.astype(int).clip(max=len(ROUGHNESSES) - 2)
    share, row = at - low, np.arange(len(at))
    return np.float32((1 - share) * by_ior[row, low] + share * by_ior[row, low + 1])
