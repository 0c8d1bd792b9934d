# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's step from light to light: which estimate to believe where, factors, and what all of them lack."""
from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.inference import is_inference
from ..fields import Channels
from ..light.direct.emitter_light import EMITTER, STRONGEST
from ..light.surface_light import SurfaceLight
from ..light_passes import LOBES
from .bundle_decoder import SAID
from .features import SURFACE, GuidedView
from .kernels import LATENT

# Share of the estimate where light was also traced; factors of direct and indirect light by lobe and colour; indirect
# light of lobes that the estimate lacks; light of media; visibility of the strongest emitters and of all other light;
# what kernels are told. The transformer says the rest: factors of light without rays, and trust in estimates.
OF_PIXELS = Channels(1, share=1, direct=9, indirect=9, missing=9, rest=3, visible=STRONGEST + 1, latent=LATENT)
OUTPUTS = OF_PIXELS.joined(**SAID.sizes(), trust=1)
LARGEST_FACTOR = 4.0    # and its inverse is the smallest
LARGEST_BY_RAYS = 1.05  # likewise, of direct light; more gains nothing on held-out scenes, and dims lonely spot beams
DARK = -3.0             # offset at which softplus adds little


def corrected_light(raw: Tensor, view: GuidedView) -> SurfaceLight:
    """Decoder channels (V, len(OUTPUTS), H, W) and the light of views -> their light as the network sees it.

    Exposed as the view's light is. Zeros leave the light exactly as it is. Where light was traced, there are two
    estimates of it that are right in different places, and the share of either is all that the network decides:
    factors that were learnt from few scenes are wrong in others. For the same reason the transformer's, and those of
    indirect light, are of light without rays only; by rays pixels change direct light a little, and the transformer
    says how far the estimate is to be trusted without that. Where the user lets no light bounce, which training never
    did, or lamps shine otherwise than estimates know, traced light is believed and nothing is added; and the more, the
    more samples it has.
    """
    light, raw = view.light, raw.float()
    untraced = 1 - light.is_traced.view(-1, 1, 1, 1)
    share = (raw[:, OUTPUTS["share"]] + raw[:, OUTPUTS["trust"]]).tanh() * view.is_known
    if is_inference():  # in training it is to learn all that it can, which is mostly of few samples
        share = share * view.surface[:, SURFACE["noise"]].clamp(max=1) ** (2 / 3)
        share = torch.maximum(share, view.unreliable)
    raw = raw * untraced
    without_rays = 1 - light.has_rays.view(-1, 1, 1, 1)
    direct = _but_of_glass(_by_lobe(raw[:, OUTPUTS["direct"]], light), light)
    indirect, missing = ((without_rays * raw[:, OUTPUTS[name]]).unflatten(1, (3, 3))
                         for name in ("indirect", "missing"))
    direct = factor_by_rays(direct) if is_inference() and light.is_by_rays() else with_shadows(direct, raw, view)
    indirect = factor(indirect)
    missing = added(missing) * view.is_known[:, None]
    of_all = (raw[:, OUTPUTS["log_factor"]] * without_rays).exp()
    in_media = view.surface[:, SURFACE["alpha"]] * view.has_media.view(-1, 1, 1, 1)
    fields = {"bounced": 0, "reflected": 1, "refracted": 2, "behind": 2}  # by lobe
    corrected = {name: of_all * (getattr(light, name) * indirect[:, lobe] + missing[:, lobe]).clamp_min(0)
                 for name, lobe in fields.items()}
    glow = of_all * (light.glow + added(raw[:, OUTPUTS["rest"]]) * in_media).clamp_min(0)
    corrected |= {"direct": light.direct * direct * of_all[:, None], "glow": glow}
    trust = (raw[:, OUTPUTS["trust"]] * light.has_rays.view(-1, 1, 1, 1)).tanh()
    believed = {name: torch.lerp(x, getattr(light, name), trust if x.ndim == 4 else trust[:, None]).clamp_min(0)
                for name, x in corrected.items()}
    light = replace(light, **believed)
    return replace(light, traced=_mixed(light.traced, light.estimate(), share) * (1 - untraced))


def _mixed(traced: Tensor, estimate: Tensor, share: Tensor) -> Tensor:
    """Light (V, 3, H, W) with a share (V, 1, H, W) of the estimate.

    A share below 0 leads away from the estimate, by no more than all of traced light: where Clamp Indirect has cut
    that, such as a flame behind glass, an estimate that is many times as bright would make it black.
    """
    return torch.lerp(traced, torch.where(share < 0, torch.minimum(estimate, 2 * traced), estimate), share).clamp_min(0)


def _by_lobe(raw: Tensor, light: SurfaceLight) -> Tensor:
    """(V, 9, H, W) -> (V, 3, 3, H, W) [lobe, rgb], by rays alike for all colours: rays have them right, and what was
    learnt of them tints white rooms."""
    raw = raw.unflatten(1, (3, 3))
    return torch.lerp(raw, raw.mean(2, keepdim=True).expand_as(raw), light.has_rays.view(-1, 1, 1, 1, 1))


def factor(raw: Tensor) -> Tensor:
    """From 1 / LARGEST_FACTOR to LARGEST_FACTOR; 1 for zero."""
    return torch.exp(math.log(LARGEST_FACTOR) * torch.tanh(raw))


def factor_by_rays(raw: Tensor) -> Tensor:
    """The same from 1 / LARGEST_BY_RAYS to LARGEST_BY_RAYS."""
    return factor(raw).clamp(1 / LARGEST_BY_RAYS, LARGEST_BY_RAYS)


def with_shadows(direct: Tensor, raw: Tensor, view: GuidedView) -> Tensor:
    """(V, 3, 3, H, W) factors of direct light; where it is unshadowed, of the diffuse lobe also the visibility of
    emitters."""
    share = view.emitters[:, :, EMITTER["share"]]
    change = visibility(raw[:, OUTPUTS["visible"], None]) - 1
    diffuse = (share * change[:, :STRONGEST]).sum(1) + (1 - share.sum(1)) * change[:, STRONGEST]
    unshadowed = visibility(direct) * torch.cat([1 + diffuse[:, None], torch.ones_like(direct[:, 1:])], 1)
    return torch.where(view.light.has_rays.view(-1, 1, 1, 1, 1) > 0, factor_by_rays(direct), unshadowed)


def visibility(raw: Tensor) -> Tensor:
    """From 0, where light without shadows is in shadow, to 2; 1 for zero."""
    return 2 * torch.sigmoid(2 * raw)


def _but_of_glass(direct: Tensor, light: SurfaceLight) -> Tensor:
    """(V, 3, 3, H, W) without the outputs for lamps and sky that glass shows by rays: that is an image, and right."""
    is_glass = torch.arange(3, device=direct.device).view(1, 3, 1, 1, 1) == LOBES.index("transmission")
    return direct * ~(is_glass & (light.has_rays.view(-1, 1, 1, 1, 1) > 0))


def added(raw: Tensor) -> Tensor:
    """Radiance, 0 for zero, and hardly less for what is negative."""
    return F.softplus(raw + DARK) - F.softplus(raw.new_full((), DARK))
