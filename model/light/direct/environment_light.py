# SPDX-License-Identifier: GPL-3.0-or-later
"""Irradiance and roughness-filtered radiance of a lat-long environment map, in closed form per direction.

Diffuse light is a map that was convolved with the clamped cosine, glossy light a stack of maps blurred by the GGX lobe
(the first half of Karis' split sum, 2013), which a lobe reads in a few directions, as it is round only where it is seen
from above (filtered importance sampling, Krivanek and Colbert 2008). The share that arrives is found by rays.
"""
from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.devices import run_operator
from ...environment import direction_map
from ...geometry import reflected
from ..chunks import in_chunks
from ..cutouts import Cutouts
from ..fresnel import reflectance
from ..media.transmittance import Fog
from ..sampling import cosine_directions, ggx_directions, local_basis
from ..tensor_rays import TensorRays
from ..vectors import unit
from .footprints import mirrored_turn2, points_within, widened_by_turn

ROUGHNESS_LEVELS = 0.0, 0.125, 0.18, 0.25, 0.5, 0.75, 1.0
POOLED = {0.125: (128, 256), 0.18: (64, 128)}  # sizes of maps whose pixels are as wide as lobes of this roughness
BLUR = 0.3                            # roughness at which one of many rays reads the map
POLISHED = 0.1                        # roughness up to which a lobe is narrow from all sides
TAPS = 32                             # of a wider lobe
FLAT = 0.01                           # radians by which mirrored directions turn in pixels that are one direction
COARSE, SMALLEST = (64, 128), (128, 256)  # map sizes of wider lobes, and of the stack at least
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
        image, size = radiance.permute(2, 0, 1)[None], tuple(max(pair) for pair in zip(radiance.shape, SMALLEST))
        coarse = F.adaptive_avg_pool2d(image, COARSE)[0]
        directions = torch.from_numpy(direction_map(*COARSE)).to(radiance.device).reshape(-1, 3)
        weight = solid_angles(*COARSE, device=radiance.device).expand(COARSE).reshape(-1)
        colors = coarse.reshape(3, -1).T
        rows, columns = COARSE
        cosines = directions[::columns] @ directions.T  # of the first column: the others see the same, turned
        ahead = torch.arange(columns, device=radiance.device)
        turned = colors.view(rows, columns, 3)[:, (ahead[:, None] + ahead) % columns].flatten(0, 1)
        arriving = torch.einsum("rs,scd->drc", cosines.clamp_min(0) * weight, turned)
        beyond = arriving.roll(columns // 2, -1)  # the poles
        arriving = torch.cat([beyond[:, :1], arriving, beyond[:, -1:]], 1)
        self._irradiance = _wrapped(arriving[None], arriving.shape[1:])  # 1, 3, row, column
        levels = [F.adaptive_avg_pool2d(image, size)]
        for roughness in ROUGHNESS_LEVELS[1:]:
            if roughness in POOLED:
                levels.append(F.adaptive_avg_pool2d(image, POOLED[roughness]))
                continue
            kernel = _lobe(cosines, roughness) * weight
            levels.append((torch.einsum("rs,scd->drc", kernel, turned) / kernel.sum(1, keepdim=True))[None])
        self.levels = torch.stack([_wrapped(level, size) for level in levels], 2)  # 1, 3, level, row, column

    def irradiance(self, normal: Tensor) -> Tensor:
        """(P, 3) irradiance on a surface with this normal, W/m^2."""
        rows, columns = self._irradiance.shape[2:]
        grid = _places(normal, columns) * torch.tensor([1, (rows - 2) / rows], device=normal.device)
        sampled = run_operator("grid_sampler_2d", F.grid_sample, self._irradiance, grid[None, :, None],
                               mode="bilinear", padding_mode="border", align_corners=False)
        return sampled[0, :, :, 0].T

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
        level = (_level(roughness.clamp(0, 1)) + 0.5) / len(ROUGHNESS_LEVELS) * 2 - 1
        grid = torch.cat([_places(direction, self.levels.shape[-1]), level[:, None]], 1)
        sampled = run_operator("grid_sampler_3d", F.grid_sample, self.levels, grid[None, :, None, None],
                               mode="bilinear", padding_mode="border", align_corners=False)
        return sampled[0, :, :, 0, 0].T

    def reflected(self, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor,
                  footprint: Tensor | None = None) -> Tensor:
        """(P, 3) radiance that a white glossy lobe sends towards `outgoing`, relative to that of uniform light.

        normal, outgoing: (P, 3), unit; roughness (perceptual), f0: (P,). footprint: (P, 2, 9), of pixels
        (footprints.py), whose mean it is then.
        """
        is_wide = (roughness > POLISHED) & (not self.is_uniform)
        is_bent = torch.zeros_like(is_wide)
        if footprint is not None:
            turn2 = mirrored_turn2(footprint)
            is_bent = ~is_wide & (turn2 > FLAT ** 2)
            roughness = torch.where(is_wide, widened_by_turn(roughness, turn2), roughness)
        radiance, rows = torch.empty_like(normal), partial(torch.nonzero, as_tuple=True)
        narrow, = rows(~is_wide & ~is_bent)
        radiance[narrow] = self.filtered(reflected(-outgoing[narrow], normal[narrow]), roughness[narrow])
        bent, = rows(is_bent)
        if len(bent):
            change = points_within(footprint[bent])
            mirrored = reflected(-unit(outgoing[bent] + change[..., 6:]), unit(normal[bent] + change[..., 3:6]))
            radiance[bent] = self.filtered(mirrored.flatten(0, 1), roughness[bent].repeat(len(change))).view_as(
                mirrored).mean(0)
        wide, = rows(is_wide)
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


def _wrapped(level: Tensor, size: tuple[int, int]) -> Tensor:
    """A map (1, 3, h, w), with so many rows and columns, and at either side the column of the other one."""
    wide = F.pad(level, (1, 1, 0, 0), mode="circular")
    step = size[1] // level.shape[-1]
    larger = F.interpolate(wide, (size[0], size[1] + 2 * step), mode="bilinear", align_corners=False)
    return larger[..., step - 1:size[1] + step + 1]


def _level(roughness: Tensor) -> Tensor:
    """(P,) index, with fractions, among ROUGHNESS_LEVELS, by alpha, which is as wide as a lobe."""
    levels = torch.tensor(ROUGHNESS_LEVELS, device=roughness.device).square()
    alpha = roughness.square().contiguous()
    above = torch.bucketize(alpha, levels).clamp(1, len(levels) - 1)
    return above - 1 + (alpha - levels[above - 1]) / (levels[above] - levels[above - 1])


def _lobe(cosine: Tensor, roughness: float) -> Tensor:
    """GGX density at the half vector times the cosine, for view = normal = reflection direction."""
    alpha2 = roughness**4
    half2 = ((1 + cosine) / 2).clamp(0, 1)
    return cosine.clamp_min(0) / (half2 * (alpha2 - 1) + 1).square()


def _places(direction: Tensor, columns: int) -> Tensor:
    """(P, 2) columns and rows of directions (P, 3) in maps of so many columns, wrapped ones, from -1 to 1."""
    u = 0.5 - torch.atan2(direction[:, 1], direction[:, 0]) / (2 * math.pi)
    row = torch.acos(direction[:, 2].clamp(-1, 1)) / math.pi
    return torch.stack([(u * (columns - 2) + 1) / columns, row], -1) * 2 - 1


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
