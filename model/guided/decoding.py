# SPDX-License-Identifier: GPL-3.0-or-later
"""Decode light, not colour: what factors the light priors need, and the light that they do not include."""
from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import Channels
from ..progress import report
from .guide_tensors import FEATURES, GuideTensors, band_rows

# RGB of each lobe, what no lobe explains, and a factor of the traced light
OUTPUTS = Channels(1, direct=9, indirect=9, rest=3, traced=3)
MOST = 4.0   # times, and its inverse at least: a factor
DARK = -8.0  # offset at which the decoder sees no light that no lobe explains
# Shares of the radiosity where the decoder starts: through glass, and behind it where that is rough
REFRACTED, BEHIND = 0.95, 0.5


def decode_light(raw: Tensor, guides: GuideTensors) -> dict[str, Tensor]:
    """Decoder channels (V, len(OUTPUTS), H, W) to radiance (V, 3, H, W) in the exposure of the guides.

    Zeros leave the priors as they are. Where light was traced, it stands for all direct light; else the prior does.
    Keys: `image` (sum of all, without directly seen emitters and world), `direct` and `indirect` (V, 3, 3, H, W), the
    light of each lobe before its colour, `rest` (volumes and whatever no lobe explains), and `traced` as it is in the
    image.
    """
    v, _, h, w = raw.shape
    raw = raw.float()
    # Rough glass shows what arrives at its back from everywhere, smooth glass what lies behind it.
    transmitted = torch.lerp(REFRACTED * guides.refracted, BEHIND * guides.behind,
                             guides.features[:, FEATURES["roughness"]])
    bounced = torch.stack([guides.bounced, guides.reflected, transmitted], dim=1)
    direct, indirect = (light * factor(raw[:, OUTPUTS[name]].reshape(v, 3, 3, h, w))
                        for name, light in (("direct", guides.prior), ("indirect", bounced)))
    rest = F.softplus(raw[:, OUTPUTS["rest"]] + DARK) * guides.features[:, FEATURES["alpha"]]
    hinted = guides.features[:, FEATURES["hinted"]]
    traced = guides.traced * factor(raw[:, OUTPUTS["traced"]])
    arriving = hinted * traced + (1 - hinted) * (direct * guides.colors).sum(1)
    rest = rest + guides.glow
    return {"image": arriving + (indirect * guides.colors).sum(1) + rest, "direct": direct, "indirect": indirect,
            "rest": rest, "traced": traced}


def factor(raw: Tensor) -> Tensor:
    """From 1 / MOST to MOST."""
    return torch.exp(math.log(MOST) * torch.tanh(raw))


def shown(radiance: Tensor) -> Tensor:
    """sRGB-encoded; beyond 1 it grows slowly, so that what is too bright still knows its way back."""
    x = radiance.clamp_min(0)
    curve = 1.055 * x.clamp(0.0031308, 1) ** (1 / 2.4) - 0.055
    return torch.where(x > 0.0031308, curve, 12.92 * x) + 0.1 * x.clamp_min(1).log()


def decode_bands(raw: Tensor, guides: GuideTensors, keys: Sequence[str]) -> dict[str, Tensor]:
    """The `keys` of `decode_light`, in bands of bounded memory."""
    done = []
    for band, known in _bands(raw, guides):
        light = decode_light(band, known)
        done.append({key: light[key] for key in keys})
    return {key: torch.cat([band[key] for band in done], dim=-2) for key in keys}


def _bands(raw: Tensor, guides: GuideTensors) -> Iterator[tuple[Tensor, GuideTensors]]:
    """Rows of the decoder's channels with their guides."""
    rows = band_rows(raw)
    names = [f.name for f in fields(guides) if f.name not in ("positions", "exposure")]
    pictures = (getattr(guides, name).split(rows, dim=-2) for name in names)
    for i, (band, *known) in enumerate(zip(raw.split(rows, dim=-2), *pictures, strict=True)):
        report(i * rows / raw.shape[2])
        yield band, replace(guides, **dict(zip(names, known, strict=True)))
