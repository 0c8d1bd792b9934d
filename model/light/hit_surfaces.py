# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces that pixels show, as tensors: where first hits are, and what their materials reflect."""
from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..camera import view_rays_at
from ..first_hits import bumps
from ..first_hits.hit_materials import UNKNOWN_F0, hit_reflectances, hit_roughness_below, hit_values
from ..material.sheen import albedo as sheen_albedo
from ..material.sheen import lean, stretch
from ..scene import Guides, RenderScene, View
from .fresnel import lobe_albedo
from .vectors import dot, length

LEANING = 0.2            # cosine up to which Cycles turns normals back
TINY = 1e-6
RAISED = 0.1             # pixels that rays start off curved surfaces, below which the mean of a pixel's first hits lies


class Coat(NamedTuple):
    """Clear coats, of h x W pixels."""

    share: Tensor      # (h, W, 3) of the albedo of the glossy lobe
    roughness: Tensor  # (h, W)
    f0: Tensor         # (h, W)


@dataclass
class HitSurfaces:
    """First hits of some rows of a view, h x W pixels; f32, network units, premultiplied where coverage counts."""

    origin: Tensor         # (3,) or (h, W, 3), of the camera rays
    rays: Tensor           # (h, W, 3), unit
    position: Tensor       # (h, W, 3)
    normal: Tensor         # (h, W, 3), unit
    coverage: Tensor       # (h, W, 1), in [0, 1]
    diffuse: Tensor        # (h, W, 3), albedo of the lobe, premultiplied by coverage
    glossy: Tensor         # (h, W, 3), likewise
    transmission: Tensor   # (h, W, 3), likewise
    roughness: Tensor      # (h, W), perceptual
    f0: Tensor             # (h, W), of the glossy lobe, relative to its reflectance at grazing angles
    diffuse_ratio: Tensor  # (h, W), diffuse over glossy albedo
    straight: Tensor | None = None  # (h, W, 1) bool, where transmission goes straight on, if it does anywhere
    translucent: Tensor | None = None  # (h, W, 3), share of diffuse light that comes from the other side, if any does
    # (h, W, 7), RGB share of diffuse light that is of a sheen, its stretch and its lean, if any is
    sheen: Tensor | None = None
    coat: Coat | None = None  # if any has one
    matte_share: Tensor | None = None  # (h, W, 1), of diffuse light that bumps finer than a pixel send on, if any are
    group: np.ndarray | None = None  # (h, W) u8, of surfaces, where lights tell some apart

    @classmethod
    def of(cls, scene: RenderScene, view: View, guides: Guides, first_row: int, device: torch.device) -> HitSurfaces:
        """The surfaces of guides, which are rows from `first_row` on of a view of a normalised scene."""
        to_tensor = tensors_on(device)
        h, w = guides.alpha.shape
        origin, rays = map(to_tensor, view_rays_at(view, np.arange(w) + 0.5, first_row + np.arange(h)[:, None] + 0.5))
        normal = F.normalize(to_tensor(guides.normal), dim=-1)
        below = hit_roughness_below(scene, guides)
        diffuse, glossy, transmission = map(
            to_tensor, (guides.diffuse_color, guides.glossy_albedo, guides.transmission_color))
        cosine, coverage = -dot(normal, rays), to_tensor(guides.alpha)[..., None].clamp(0, 1)
        f0 = _relative_f0(*map(to_tensor, hit_reflectances(scene, guides)), cosine, to_tensor(below))
        translucent, sheen, coat = (None if values is None else to_tensor(hit_values(scene, guides, values))
                                    for values in (scene.translucent, scene.sheen, scene.coat))
        return cls(origin, rays, to_tensor(guides.position), normal, coverage,
                   diffuse, glossy, transmission, to_tensor(bumps.with_bumps(below, guides.normal_variance)), f0,
                   diffuse.mean(-1) / glossy.mean(-1).clamp_min(1e-6),
                   None if guides.straight is None else torch.from_numpy(guides.straight).to(device)[..., None],
                   translucent,
                   None if sheen is None else _sheen(sheen, normal, -rays, coverage, diffuse),
                   None if coat is None else _coat(coat, cosine, coverage, glossy),
                   None if guides.matte_share is None else to_tensor(guides.matte_share)[..., None],
                   None if scene.group is None or not len(scene) else scene.group[guides.hit_triangle.clip(0)])

    def crop(self, pixels: slice | tuple[slice, slice]) -> HitSurfaces:
        """Those of some rows, or of a rectangle of rows and columns; shared memory."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        of_pixels = {name: value[pixels] for name, value in values.items()
                   if value is not None and name != "coat" and (name != "origin" or value.dim() > 1)}
        return replace(self, **of_pixels, coat=self.coat and Coat(*(value[pixels] for value in self.coat)))

    @property
    def coated(self) -> HitSurfaces | None:
        """The surfaces with a clear coat alone, the glossy lobe being that of the coat."""
        if self.coat is None or not self.coat.share.any():
            return None
        is_coated = self.coat.share.amax(-1, keepdim=True) > 0
        return replace(self, roughness=self.coat.roughness, f0=self.coat.f0, coverage=self.coverage * is_coated,
                       coat=None)

    @property
    def lobe_points(self) -> tuple[Tensor, ...]:
        """Position, normal, unit vector to the viewer (h W, 3), roughness and f0 (h W,): what `DirectLight.lobes` asks.
        """
        points = self.position, self.normal, -self.rays, self.roughness, self.f0
        return tuple(x.flatten(0, 1) for x in points)

    @property
    def rise(self) -> Tensor:
        """(h, W, 1) distance off the surface at which rays start, on either side."""
        distance = length(self.position - self.origin)[..., None]
        if self.rays.shape[1] < 2:
            return torch.zeros_like(distance)
        origins, rays = (torch.diff(x.expand_as(self.rays)[:, :2], dim=1) for x in (self.origin, self.rays))
        return RAISED * length(origins + distance * rays)[..., None]

    @property
    def is_glass(self) -> Tensor:
        """(h, W, 1) bool: where transmission is that of glass, and does not go straight on."""
        passes = self.transmission.amax(-1, keepdim=True) > 0
        return passes if self.straight is None else passes & ~self.straight

    @property
    def is_toward(self) -> Tensor:
        """(h, W, 1) bool: not where smooth shading gives a face the normal of its back, and Cycles shows no gloss."""
        return dot(self.normal, self.rays)[..., None] < LEANING

    @property
    def is_covered(self) -> Tensor:
        """(h, W, 1) bool: pixels that show a surface."""
        return self.coverage > 0


def tensors_on(device: torch.device):
    """A function from arrays to f32 tensors on a device."""
    return lambda x: torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32, device=device)


def _sheen(sheen: Tensor, normal: Tensor, viewer: Tensor, coverage: Tensor, diffuse: Tensor) -> Tensor:
    """(h, W, 7) as HitSurfaces.sheen, of one (h, W, 4) as of RenderScene.

    normal, viewer: (h, W, 3), unit; diffuse: (h, W, 3), of all of the diffuse lobe.
    """
    color, roughness = sheen.split([3, 1], -1)
    cosine = dot(normal, viewer)
    albedo = torch.from_numpy(sheen_albedo(cosine.cpu().numpy(), roughness[..., 0].cpu().numpy())).to(color)
    reflected = coverage * color * albedo[..., None]
    aside = F.normalize(viewer - cosine[..., None] * normal, dim=-1)
    return torch.cat([reflected / torch.maximum(diffuse, reflected).clamp_min(TINY),
                      stretch(roughness, cosine[..., None]), lean(roughness, cosine[..., None]) * aside], -1)


def _coat(coat: Tensor, cosine: Tensor, coverage: Tensor, glossy: Tensor) -> Coat:
    """coat: (h, W, 4) as of RenderScene; glossy: (h, W, 3), of all of the glossy lobe; others as above."""
    weight, f0, roughness, _ = coat.unbind(-1)
    albedo = weight * lobe_albedo(f0.flatten(), cosine.flatten(), roughness.flatten()).view_as(cosine)
    return Coat((coverage * albedo[..., None] / glossy.clamp_min(TINY)).clamp(0, 1), roughness, f0)


def _relative_f0(metal: Tensor, metal_f0: Tensor, layer: Tensor, layer_f0: Tensor, cosine: Tensor,
                 roughness: Tensor) -> Tensor:
    """(h, W) f0 of surfaces of metal and a layer, both of which reflect all light at grazing angles.

    Arguments as of `hit_reflectances`; cosine: between normal and viewer.
    """
    albedo = lobe_albedo(torch.ones(()), cosine.flatten(), roughness.flatten()).view_as(cosine)
    metal = metal / albedo  # light that bounces between its facets is uniform
    reflects = metal + layer
    f0 = (metal * metal_f0 + layer * layer_f0) / reflects.clamp_min(1e-6)
    return torch.where(reflects > TINY, f0, UNKNOWN_F0)  # gloss that the texel does not know
