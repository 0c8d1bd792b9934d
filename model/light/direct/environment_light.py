# SPDX-License-Identifier: GPL-3.0-or-later
"""Irradiance and roughness-filtered radiance of a lat-long environment map, in closed form per direction.

Diffuse light uses nine spherical-harmonic coefficients (Ramamoorthi and Hanrahan 2001), glossy light a stack of maps
blurred by the GGX lobe (the first half of Karis' split sum, 2013), which a lobe reads in a few directions, as it is
round only where it is seen from above (filtered importance sampling, Krivanek and Colbert 2008). The share that arrives
is found by rays.
"""
from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.devices import run_operator
from ...environment import direction_map
from ..chunks import in_chunks
from ..cutouts import Cutouts
from ..fresnel import reflectance
from ..media.transmittance import Fog
from ..sampling import cosine_directions, ggx_directions, local_basis
from ..tensor_rays import TensorRays
from ..vectors import dot

ROUGHNESS_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
BLUR = 0.3                            # roughness at which one of many rays reads the map
POLISHED = 0.1                        # roughness up to which a lobe is narrow from all sides
TAPS = 32                             # of a wider lobe
SHARP, COARSE = (64, 128), (32, 64)  # map sizes of level 0 and of the blurred levels
COSINE_LOBE = (math.pi, 2 * math.pi / 3, math.pi / 4)  # zonal coefficients of the clamped cosine, bands 0, 1, 2
LIFT = 1e-4      # network units that a ray starts off its surface
FOG_REACH = 2.0  # network units from a point: fog beyond dims nothing
CHUNK = 4096     # points at a time


def solid_angles(height: int, width: int, device=None) -> Tensor:
    """(H, 1) f32, steradians per pixel of a row."""
    edges = torch.cos(math.pi * torch.arange(height + 1, device=device) / height)
    return ((edges[:-1] - edges[1:]) * 2 * math.pi / width)[:, None]


class EnvironmentLight:
    """Built from (H, W, 3) radiance; `irradiance` and `filtered` take (P, 3) unit directions."""

    def __init__(self, radiance: Tensor):
        self.is_uniform = bool((radiance == radiance[0, 0]).all())
        image = radiance.permute(2, 0, 1)[None]
        coarse = F.adaptive_avg_pool2d(image, COARSE)[0]
        directions = torch.from_numpy(direction_map(*COARSE)).to(radiance.device).reshape(-1, 3)
        weight = solid_angles(*COARSE, device=radiance.device).expand(COARSE).reshape(-1)
        colors = coarse.reshape(3, -1).T
        self.harmonics = _harmonics(directions).T @ (colors * weight[:, None])
        rows, columns = COARSE
        cosines = directions[::columns] @ directions.T  # of the first column: the others see the same, turned
        ahead = torch.arange(columns, device=radiance.device)
        turned = colors.view(rows, columns, 3)[:, (ahead[:, None] + ahead) % columns].flatten(0, 1)
        levels = [F.adaptive_avg_pool2d(image, SHARP)[0]]
        for roughness in ROUGHNESS_LEVELS[1:]:
            kernel = _lobe(cosines, roughness) * weight
            blurred = torch.einsum("rs,scd->drc", kernel, turned) / kernel.sum(1, keepdim=True)
            levels.append(F.interpolate(blurred[None], SHARP, mode="bilinear", align_corners=False)[0])
        stack = torch.stack(levels, 1)[None]                       # 1, 3, level, row, column
        self.levels = torch.cat([stack[..., -1:], stack, stack[..., :1]], -1)  # wrap around

    def irradiance(self, normal: Tensor) -> Tensor:
        """(P, 3) irradiance on a surface with this normal, W/m^2."""
        bands = torch.tensor([0, 1, 1, 1, 2, 2, 2, 2, 2], device=normal.device)
        lobe = torch.tensor(COSINE_LOBE, device=normal.device)[bands]
        return (_harmonics(normal) @ (self.harmonics * lobe[:, None])).clamp_min(0)

    def visible_share(self, directions: Tensor, visibility: Tensor, weight: Tensor | None = None) -> Tensor:
        """(P, 3) share of the RGB radiance from (P, R, 3) unit vectors that arrives, of each (P, R, 1) or (P, R, 3).

        weight: (P, R), of the vectors; all count alike without it.
        """
        flat = directions.flatten(0, 1)
        radiance = self.filtered(flat, torch.full_like(flat[:, 0], BLUR)).view_as(directions).clamp_min(1e-12)
        radiance = radiance if weight is None else weight[..., None] * radiance
        return (visibility * radiance).sum(1) / radiance.sum(1).clamp_min(1e-30)

    def filtered(self, direction: Tensor, roughness: Tensor) -> Tensor:
        """(P, 3) radiance around a direction, averaged over the GGX lobe of this perceptual roughness (P,)."""
        if self.is_uniform:
            return self.levels[0, :, 0, 0, 0].expand(len(direction), 3)
        u = 0.5 - torch.atan2(direction[:, 1], direction[:, 0]) / (2 * math.pi)
        w = torch.acos(direction[:, 2].clamp(-1, 1)) / math.pi
        wrapped = (u * SHARP[1] + 1) / (SHARP[1] + 2)
        step = roughness.clamp(0, 1) * (len(ROUGHNESS_LEVELS) - 1)
        # Lobes are as wide as the square of roughness: nearly sharp ones are no mixture of a sharp and a wide one.
        level = (torch.where(step < 1, step ** 3, step) + 0.5) / len(ROUGHNESS_LEVELS)
        grid = torch.stack([wrapped, w, level], -1) * 2 - 1
        sampled = run_operator("grid_sampler_3d", F.grid_sample, self.levels, grid[None, :, None, None],
                               mode="bilinear", padding_mode="border", align_corners=False)
        return sampled[0, :, :, 0, 0].T

    def reflected(self, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor) -> Tensor:
        """(P, 3) radiance that a white glossy lobe sends towards `outgoing`, relative to that of uniform light.

        normal, outgoing: (P, 3), unit; roughness (perceptual), f0: (P,).
        """
        mirrored = 2 * dot(normal, outgoing)[..., None] * normal - outgoing
        is_wide = (roughness > POLISHED) & (not self.is_uniform)
        narrow, wide = (~is_wide).nonzero()[:, 0], is_wide.nonzero()[:, 0]
        radiance = torch.empty_like(mirrored)
        radiance[narrow] = self.filtered(mirrored[narrow], roughness[narrow])
        radiance[wide] = self._tapped(normal[wide], outgoing[wide], roughness[wide], f0[wide])
        return radiance

    def _tapped(self, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor) -> Tensor:
        """`reflected` of wide lobes, read in TAPS directions of each."""
        x, y = (local_basis(normal)[:, :2] @ outgoing[..., None])[..., 0].unbind(1)
        start = torch.stack([torch.full_like(x, 0.5), torch.atan2(y, x) / (2 * math.pi)], 1)  # as the viewer is turned
        direction, weight, cosine, density = ggx_directions(normal, outgoing, roughness, TAPS, start)
        weight = weight * reflectance(f0[:, None], cosine)
        weight = weight / weight.sum(1, keepdim=True).clamp_min(1e-6)
        # A lobe of this roughness has the solid angle of a tap, 4 pi alpha^2.
        blur = torch.minimum((4 * math.pi * TAPS * density).clamp_min(1e-6) ** -0.25, roughness[:, None])
        taps = self.filtered(direction.flatten(0, 1), blur.flatten()).view_as(direction)
        return (weight[..., None] * taps).sum(1)


def _lobe(cosine: Tensor, roughness: float) -> Tensor:
    """GGX density at the half vector times the cosine, for view = normal = reflection direction."""
    alpha2 = roughness**4
    half2 = ((1 + cosine) / 2).clamp(0, 1)
    return cosine.clamp_min(0) / (half2 * (alpha2 - 1) + 1).square()


def _harmonics(d: Tensor) -> Tensor:
    """(P, 9) real spherical harmonics of bands 0 to 2."""
    x, y, z = d.unbind(-1)
    return torch.stack([
        torch.full_like(x, 0.282095), 0.488603 * y, 0.488603 * z, 0.488603 * x,
        1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
    ], -1)


class SkyVisibility:
    """Rays that miss all occluders, weighted by the environment's radiance."""

    def __init__(self, occluders: TensorRays, environment: EnvironmentLight, fog: Fog | None = None,
                 cutouts: Cutouts | None = None):
        self.occluders, self.environment, self.fog, self.cutouts = occluders, environment, fog, cutouts

    def __call__(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Tensor:
        """(P, 3) share of the environment's RGB irradiance that arrives at points (P, 3) with unit normals (P, 3).

        start: (P, 2) in [0, 1), as of `cosine_directions`.
        """
        return in_chunks(CHUNK, partial(self._trace, rays), position, normal, start)

    def _trace(self, rays: int, x: Tensor, n: Tensor, start: Tensor) -> Tensor:
        direction = cosine_directions(n, rays, start)
        ray = (x + LIFT * n)[:, None].expand_as(direction).reshape(-1, 3), direction.reshape(-1, 3)
        visible = (~self.occluders.is_blocked(*ray)).view(-1, rays, 1).to(x.dtype)
        if self.cutouts is not None:
            distance = torch.where(visible > 0, torch.inf, 0.0).flatten()
            visible = visible * self.cutouts.transmittance(*ray, distance).view_as(direction)
        if self.fog is not None:
            visible = visible * self.fog.transmittance(x[:, None], x[:, None] + FOG_REACH * direction)
        return self.environment.visible_share(direction, visible)
