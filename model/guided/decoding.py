# SPDX-License-Identifier: GPL-3.0-or-later
"""Decode light, not colour: the visibility of the prior, and the light that the prior does not include."""
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

LOBES = ("diffuse", "glossy", "transmission")
# RGB of each lobe, what no lobe explains, and a factor of the traced light
OUTPUTS = Channels(1, visibility=9, indirect=9, rest=3, traced=3)
MOST = 4.0                 # times, and its inverse at least: this factor
MAX_VISIBILITY = 1.2       # the prior's glossy lobe is approximate: leave room above 1
VISIBLE, DARK = 1.5, -6.0  # offsets that start the decoder near "everything visible, nothing indirect"
# Shares of the radiosity where the decoder starts: on a surface, as seen in mirrors and through glass, behind the glass
BOUNCED, REFLECTED, REFRACTED, BEHIND = 1.0, 0.85, 0.95, 0.5


def decode_light(raw: Tensor, guides: GuideTensors) -> dict[str, Tensor]:
    """Decoder channels (V, len(OUTPUTS), H, W) to radiance (V, 3, H, W) in network exposure.

    Where light was traced, it stands for all direct light, less its noise; else the prior times its visibility does.
    Keys: `image` (sum of all, without directly seen emitters and world), `direct` and `indirect` (V, 3, 3, H, W), the
    light of each lobe before its colour, `rest` (volumes and whatever no lobe explains), and `traced` as it is in the
    image.
    """
    v, _, h, w = raw.shape
    raw = raw.float()
    visibility = MAX_VISIBILITY * torch.sigmoid(raw[:, OUTPUTS["visibility"]] + VISIBLE).reshape(v, 3, 3, h, w)
    # Rough glass shows what arrives at its back from everywhere, smooth glass what lies behind it.
    transmitted = torch.lerp(REFRACTED * guides.refracted, BEHIND * guides.behind,
                             guides.features[:, FEATURES["roughness"]])
    start = _softplus_inverse(torch.cat([BOUNCED * guides.bounced, REFLECTED * guides.reflected, transmitted], dim=1))
    indirect = F.softplus(raw[:, OUTPUTS["indirect"]] + start).reshape(v, 3, 3, h, w)
    rest = F.softplus(raw[:, OUTPUTS["rest"]] + DARK) * guides.features[:, FEATURES["alpha"]]
    direct = guides.prior * visibility
    hinted = guides.features[:, FEATURES["hinted"]]
    traced = guides.traced * factor(raw[:, OUTPUTS["traced"]])
    arriving = hinted * traced + (1 - hinted) * (direct * guides.colors).sum(1)
    return {"image": arriving + (indirect * guides.colors).sum(1) + rest, "direct": direct, "indirect": indirect,
            "rest": rest, "traced": traced}


def factor(raw: Tensor) -> Tensor:
    """From 1 / MOST to MOST."""
    return torch.exp(math.log(MOST) * torch.tanh(raw))


def _softplus_inverse(y: Tensor) -> Tensor:
    y = y.clamp_min(2e-3)  # about softplus of DARK
    return y + torch.log(-torch.expm1(-y))


def decode_image(raw: Tensor, guides: GuideTensors) -> Tensor:
    """`image` of `decode_light`, in bands of bounded memory."""
    return decode_bands(raw, guides, ("image",))["image"]


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
    names = [f.name for f in fields(guides) if f.name != "positions"]
    pictures = (getattr(guides, name).split(rows, dim=-2) for name in names)
    for i, (band, *known) in enumerate(zip(raw.split(rows, dim=-2), *pictures, strict=True)):
        report(i * rows / raw.shape[2])
        yield band, replace(guides, **dict(zip(names, known, strict=True)))
