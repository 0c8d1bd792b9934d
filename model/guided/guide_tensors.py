# SPDX-License-Identifier: GPL-3.0-or-later
"""Guides of a view as tensors: the data of every pixel that the guided network is given."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..camera import view_rays_at
from ..compute.buffers import like
from ..fields import COLOR, DIRECTION, POINT, Channels, array
from ..geometry import contracted
from ..geometry import reflected as reflected_ray
from ..light.bounce.probes import NOISY, Probes, grid_of
from ..light.bounce.radiosity import Radiosity
from ..light.direct.direct_light import SKY_RAYS, DirectLight
from ..light.edges import Edges, edges
from ..light.effort import FULL, Effort
from ..light.fresnel import whole
from ..light.sampling import r2_starts
from ..light.specular.paths import BLURRED, blur
from ..lobes import LOBES
from ..material.reflectance import normal_reflectance
from ..progress import part
from ..scene import (
    BASE_COLOR,
    IOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    TILE_CHANNELS,
    TRANSMISSION,
    Guides,
    RenderScene,
    View,
    texels,
)
from ..tensor_group import TensorGroup
from .exposure import key_exposure

FEATURES = Channels(
    1,
    offset=(3, DIRECTION),    # from the bundle's position
    normal=(3, DIRECTION),
    colors=(9, COLOR),        # diffuse, glossy, transmission
    roughness=1,
    alpha=1,                  # coverage
    light=(9, COLOR),         # log10(1 + prior) of the lobes
    mirrored=(3, DIRECTION),  # the ray, mirrored
    bounced=(3, COLOR),       # log10(1 + radiosity)
    traced=(3, COLOR),        # log10(1 + traced light)
    hinted=1,                 # 1 if light was traced
    reflected=(3, COLOR),     # log10(1 + radiosity) of what is seen in mirrors
    refracted=(3, COLOR),     # and through glass
)
# Guides that are radiance, and the features that tell the network of them
RADIANCE = {"prior": "light", "bounced": "bounced", "behind": None, "reflected": "reflected", "refracted": "refracted",
            "traced": "traced", "glow": None}
SHADOW_RAYS, LAMP_RAYS = 16, 4  # of a pixel, and of them those to one lamp
LEAST_MATTE = 1e-3        # share of the light of a diffuse lobe over a glossy one's: with less nobody sees it
SAME_SHADOW = 0.3         # difference of the shares of light in a penumbra, whose noise is smoothed
BANDS = 0.95              # of the work on guides, before edges are smoothed
BAND_PIXELS = 1 << 17     # computed at once: guides of a large picture are gigabytes
OFFSET_SCALE = 8.0        # in-bundle offsets are a few hundredths of a unit
BEYOND = 4.0              # network units from a camera that sees nothing: no volume is farther off
UNSEEN_DISTANCE = 2.0     # where a bundle that hits nothing is placed along its rays, network units
UNKNOWN_ROUGHNESS = 0.5   # where no token triangle lies behind a pixel (hair, sub-pixel geometry)
UNKNOWN_REFLECTANCE = 0.04  # there, of a layer at normal incidence
LEAST_LAYER = 5e-3        # reflectance at normal incidence from which on a layer reflects all at grazing


@dataclass
class GuideTensors(TensorGroup):
    """V views, H x W pixels, R ray bundles; all f32, in network units, radiance in an exposure of the view's own.

    The three lobes of `colors` and `prior` are diffuse, glossy, transmission.
    """

    features: Tensor = array("V", len(FEATURES), "H", "W", channels=FEATURES)
    colors: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})  # [lobe, rgb], premultiplied by coverage
    prior: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})   # radiance of a white lobe (DirectLight)
    positions: Tensor = array("V", "R", 3, behaves=POINT)            # mean first hit of every bundle
    bounced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})    # radiosity: radiance of a white diffuse surface
    behind: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})     # the same of its other side, where light passes
    reflected: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # radiance of what mirrors show, by radiosity
    refracted: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # and glass
    traced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})     # radiance; 0 if nothing was traced
    glow: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})       # radiance of volumes; 0 if light was traced
    exposure: Tensor = array("V")                                    # times network exposure


def guide_tensors(scene: RenderScene, view: View, guides: Guides, prior: DirectLight, radiosity: Radiosity,
                  patch: int, effort: Effort = FULL, direct: bool = True) -> GuideTensors:
    """Tensors of one view (V = 1) on the prior's device, for ray bundles of `patch` pixels along a side.

    Scene, view, guides and prior are all normalised; H and W are multiples of `patch`. Without `direct` there is no
    light in `prior`: where light was traced, the picture shows that instead.
    """
    h, w = guides.alpha.shape
    rows, effort = _rows(w, patch), effort.of_picture(view.width * view.height)
    features = light = pictures = None
    bundles = []
    for begin in range(0, h, rows):
        pixels = slice(begin, begin + rows)
        with part(BANDS * begin / h, BANDS * min(begin + rows, h) / h):
            band = _band(scene, view, guides, prior, radiosity, pixels, patch, effort, direct)
        if features is None:
            features, light, pictures = (like(each, h, 1) for each in (band.features, band.light, band.pictures))
        features[:, pixels], light[:, pixels], pictures[:, pixels] = band.features, band.light, band.pictures
        bundles.append(band.positions)
    if effort.edges:
        with part(BANDS, 1.0):
            _smooth_edges(edges(scene, view, guides, light.device), pictures, light if direct else None)
    lobes = lambda x: x.view(1, 3, 3, h, w)  # noqa: E731
    return exposed(GuideTensors(features[None], lobes(features[FEATURES["colors"]]), lobes(light),
                                torch.cat(bundles)[None], *(picture[None] for picture in pictures.split(3)),
                                torch.ones(1, device=light.device)))


def _smooth_edges(found: Edges, pictures: Tensor, light: Tensor | None) -> None:
    """Of `_Band.pictures` (18, H, W), and of direct light (9, H, W) if there is any."""
    for picture, lobe in zip(pictures.split(3), ("diffuse", "transmission", "glossy", "transmission")):
        found.mix(picture, LOBES.index(lobe))
    if light is not None:
        for lobe, lit in enumerate(light.split(3)):  # highlights are smaller than pixels, and bright: none may spread
            found.mix(lit, lobe, dims_only=lobe != LOBES.index("diffuse"))


def exposed(guides: GuideTensors) -> GuideTensors:
    """Of one view in network exposure, in the exposure of what it sees; the features of radiance are filled in."""
    untraced = 1 - guides.features[:, FEATURES["hinted"], None]
    light = untraced * guides.prior + torch.stack([guides.bounced, guides.reflected, guides.refracted], dim=1)
    image = (guides.traced + guides.glow + (light * guides.colors).sum(1)).mean(1)
    exposure = key_exposure(image[guides.features[:, FEATURES.index("alpha")] > 0])
    radiance = {name: getattr(guides, name) * exposure for name in RADIANCE}
    features = guides.features
    for name, feature in RADIANCE.items():
        if feature:
            features[:, FEATURES[feature]] = torch.log10(1 + radiance[name].flatten(1, -3))
    return replace(guides, features=features, exposure=exposure.expand(1), **radiance)


@dataclass
class _Band:
    """Some rows of the picture, whole bundles."""

    features: Tensor   # (C, h, W)
    light: Tensor      # (9, h, W)
    positions: Tensor  # (R, 3)
    pictures: Tensor   # (18, h, W): bounced, behind, reflected, refracted, traced, glow


def _band(scene: RenderScene, view: View, guides: Guides, prior: DirectLight, radiosity: Radiosity, rows: slice,
          patch: int, effort: Effort, direct: bool) -> _Band:
    device = prior.radiance.device
    tensor = lambda x: torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32, device=device)  # noqa: E731
    guides = Guides(**{name: array[rows] for name, array in guides.arrays().items()})
    h, w = guides.alpha.shape
    origin, rays = map(tensor, view_rays_at(view, np.arange(w) + 0.5, rows.start + np.arange(h)[:, None] + 0.5))
    position, alpha = tensor(guides.position), tensor(guides.alpha)[..., None].clamp(0, 1)
    normal = F.normalize(tensor(guides.normal), dim=-1)
    roughness = tensor(hit_roughness(scene, guides))
    diffuse_color, glossy_color, transmission_color = (
        tensor(c) for c in (guides.diffuse_color, guides.glossy_color, guides.transmission_color))
    matte = diffuse_color.mean(-1) / glossy_color.mean(-1).clamp_min(1e-6)
    gloss = torch.stack([roughness, _at_normal(*map(tensor, hit_reflectances(scene, guides)),
                                               -(normal * rays).sum(-1), roughness), matte], -1)
    coarse, noisy = max(grid_of(view.longer_side), effort.probe_grid), NOISY[:effort.smoothings]
    probes_of = partial(Probes, grid=coarse, finest=max(coarse // effort.closer, 1))
    probes = probes_of(position, normal, alpha > 0)
    was_traced = guides.traced is not None
    leaving = partial(_leaving, radiosity, None if was_traced else prior, effort)
    with part(0.0, 0.3):
        bounced, *others = probes.gathered(partial(radiosity, effort=effort, alone=not direct),
                                           spreads=noisy).split(3, dim=-1)
    with part(0.3, 0.4):
        mean = roughness[..., None] > BLURRED  # of all around, which no smoothing blurs
        glossily = sum(probes.gathered(
            lambda x, n, number, v, g: radiosity.glossy(x, n, v, g, number, effort, was_traced, direct), -rays, gloss,
            where=(alpha > 0) & where, spreads=spreads)
            for where, spreads in ((~mean, NOISY[:1]), (mean, noisy)))
        around = glossily[..., :3]
        if was_traced:
            missed = glossily[..., 3:6]
            around = around + missed
            bounced = (bounced - missed / matte[..., None].clamp_min(LEAST_MATTE)).clamp_min(0)
    with part(0.4, 0.5):
        behind = probes.gathered(lambda x, n, number: leaving(x, -n, number), spreads=noisy,
                                 where=transmission_color.amax(-1, keepdim=True) > 0)
    seen = lambda *ends: probes_of(*ends).gathered(leaving, spreads=noisy)  # noqa: E731
    with part(0.5, 0.6):
        mirrored_light, ends = _seen_light(seen, guides, "reflected", tensor)
        reflected = torch.lerp(around, mirrored_light, (1 - blur(roughness)[..., None]) * ends)
    with part(0.6, 0.7):
        refracted, ends = _seen_light(seen, guides, "refracted", tensor)
    light = torch.zeros_like(position).repeat(1, 1, 3)
    if direct:
        with part(0.7, 0.9):
            lamps_share = _lamps_seen(prior, effort, probes, not was_traced, -rays, gloss[..., :2])
        with part(0.9, 1.0):
            followed = guides.refracted_light is not None
            sky_behind = torch.full_like(alpha, not followed)
            shares = torch.cat([others[1], lamps_share, glossily[..., -3:], sky_behind], dim=-1) * (alpha > 0)
            *places, of_gloss, shares = (x.flatten(0, 1) for x in (position, normal, -rays, gloss[..., :2], shares))
            light = prior(*places, *of_gloss.unbind(1), shares).view(h, w, 9) * (alpha > 0)
            if followed:
                light[..., 6:] = tensor(guides.refracted_light) * (1 - roughness[..., None])
    hinted = torch.full_like(alpha, was_traced)
    traced = tensor(guides.traced).clamp_min(0) if was_traced else torch.zeros_like(position)
    colors = torch.cat([diffuse_color, glossy_color, transmission_color], -1)
    near = contracted(position)
    bundles = bundle_positions(near, alpha, rays, origin, patch)
    offset = (near - bundles.repeat_interleave(patch, 0).repeat_interleave(patch, 1)) * OFFSET_SCALE * (alpha > 0)
    mirrored = reflected_ray(rays, normal)
    features = torch.cat([offset, normal, colors, roughness[..., None], alpha, light, mirrored, bounced, traced, hinted,
                          reflected, refracted], -1)  # radiance is not exposed yet
    glow = torch.zeros_like(position) if was_traced else _glow(prior, origin, rays, position, normal)
    return _Band(features.permute(2, 0, 1), light.permute(2, 0, 1), bundles.reshape(-1, 3),
                 torch.cat([bounced, behind, reflected, refracted, traced, glow], -1).permute(2, 0, 1))


def _at_normal(metal: Tensor, layer: Tensor, reflectance: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(h, W) reflectance at normal incidence over that at grazing of surfaces of metal, which has 1, and a layer.

    The first three as of `hit_reflectances`; cosine between normal and viewer.
    """
    every = whole(torch.ones(()), cosine.flatten(), roughness.flatten()).view_as(cosine)
    metal = metal / every  # what bounces between its facets is added evenly
    return (metal + layer * reflectance) / (metal + layer).clamp_min(1e-6)


def _glow(prior: DirectLight, origin: Tensor, rays: Tensor, position: Tensor, normal: Tensor) -> Tensor:
    """(h, W, 3) radiance of the volumes before what is hit."""
    if prior.in_scattering is None:
        return torch.zeros_like(position)
    hit = normal.square().sum(-1, keepdim=True) > 0.25
    end = torch.where(hit, position, origin + BEYOND * rays)
    return prior.in_scattering(origin.expand_as(end).flatten(0, 1), end.flatten(0, 1)).view_as(end)


def shadow_grid(lamps: int) -> int:
    """Pixels between points where shadows of so many lamps are looked for."""
    return next((grid for most, grid in ((SHADOW_RAYS, 1), (4 * SHADOW_RAYS, 2)) if lamps <= most), 4)


def _lamps_seen(prior: DirectLight, effort: Effort, probes: Probes, sharp: bool, *glossy: Tensor) -> Tensor:
    """(h, W, 6) `DirectLight.lamps_share`; where light was traced as well, shadows need not be `sharp`.

    glossy: (h, W, ...), what that is told of glossy light.
    """
    grid = min(max(shadow_grid(len(prior.radiance)), effort.shadow_grid), probes.grid) if sharp else probes.grid
    probes = Probes(*probes.picture, grid, grid)
    return probes.gathered(partial(_lamps_share, prior, effort), *glossy, spreads=NOISY[:effort.smoothings],
                           tolerance=SAME_SHADOW)


def _lamps_share(prior: DirectLight, effort: Effort, x: Tensor, n: Tensor, number: Tensor, outgoing: Tensor,
                 gloss: Tensor) -> Tensor:
    """`DirectLight.lamps_share` by some rays to every lamp: SHADOW_RAYS of all together, LAMP_RAYS at most."""
    count = max(min(SHADOW_RAYS // max(len(prior.radiance), 1), effort.of(LAMP_RAYS)), 1)
    start = torch.stack([r2_starts(count * number + k) for k in range(count)], 1)
    return prior.lamps_share(x, n, start, outgoing, *gloss.unbind(1))


def _leaving(radiosity: Radiosity, prior: DirectLight | None, effort: Effort, x: Tensor, n: Tensor,
             number: Tensor) -> Tensor:
    """(P, 3) light that white diffuse surfaces send on: what has bounced before, and with a prior direct light too."""
    with part(0.0, 0.5):
        bounced = radiosity(x, n, number, effort, alone=True)
    with part(0.5, 1.0):
        if prior is None:
            return bounced
        return bounced + prior.diffuse(x, n, prior.arriving(x, n, sky_rays=effort.of(SKY_RAYS)))


def _seen_light(lit: Callable, guides: Guides, name: str, tensor) -> tuple[Tensor, Tensor]:
    """(h, W, 3) radiance of the surfaces that the paths of this `name` end at, and (h, W, 1) where they end at any."""
    parts = [getattr(guides, f"{name}_{kind}") for kind in ("position", "normal", "color")]
    if parts[0] is None:
        dark = tensor(np.zeros_like(guides.position))
        return dark, dark[..., :1] > 0
    position, normal, color = map(tensor, parts)
    ends = color.amax(-1, keepdim=True) > 0
    return lit(position, F.normalize(normal, dim=-1), ends) * color, ends


def bundle_positions(position: Tensor, alpha: Tensor, rays: Tensor, origin: Tensor, patch: int) -> Tensor:
    """(H / patch, W / patch, 3) mean first hit of each bundle; some way along its mean ray where it hits nothing.

    `position` and the result are in contracted space.
    """
    weight = (alpha > 0).float()
    pooled = F.avg_pool2d(torch.cat([position * weight, weight, rays], -1).permute(2, 0, 1)[None], patch)[0]
    hit, share, ray = pooled.permute(1, 2, 0).split([3, 1, 3], -1)
    unseen = contracted(origin + UNSEEN_DISTANCE * F.normalize(ray, dim=-1))
    return torch.where(share > 0, hit / share.clamp_min(1e-6), unseen)


def band_rows(picture: Tensor, patch: int = 1) -> int:
    """Rows of a band of (V, C, H, W) that fits into memory, whole ray bundles; all with gradients."""
    views, _, height, width = picture.shape
    return height if torch.is_grad_enabled() else _rows(views * width, patch)


def _rows(width: int, patch: int) -> int:
    return max(BAND_PIXELS // width // patch, 1) * patch


def hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the texel that each pixel centre hits."""
    roughness = _hit_texels(scene, guides, slice(ROUGHNESS, ROUGHNESS + 1))[..., 0]
    return np.where(guides.hit_triangle >= 0, roughness, np.float32(UNKNOWN_ROUGHNESS))


def hit_reflectances(scene: RenderScene, guides: Guides) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(H, W) f32 each, of the same texel: what its metal reflects, its share of a layer, and what that reflects.

    The last at normal incidence; a layer that reflects next to nothing there is none.
    """
    texel = _hit_texels(scene, guides, slice(NORMAL.start))
    known, metallic, transmission = guides.hit_triangle >= 0, texel[..., METALLIC], texel[..., TRANSMISSION]
    layer = normal_reflectance(texel[..., IOR].clip(1)) * (1 - transmission / 2)  # whose index glass has itself
    layer = np.where(known, layer, UNKNOWN_REFLECTANCE)
    metal = known * metallic * texel[..., BASE_COLOR].mean(-1)
    return metal, (1 - known * metallic) * (layer / LEAST_LAYER).clip(max=1), layer


def _hit_texels(scene: RenderScene, guides: Guides, channels: slice) -> np.ndarray:
    """(H, W, C) f32, such channels of the material tiles; whatever where nothing is hit."""
    hit = guides.hit_triangle
    if not len(scene.triangles):
        return np.zeros((*hit.shape, len(range(TILE_CHANNELS)[channels])), np.float32)
    x, y = texels(guides.hit_barycentric)
    return scene.tiles[scene.tile_index[np.maximum(hit, 0)], channels, y, x].astype(np.float32)
