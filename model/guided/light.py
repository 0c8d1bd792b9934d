# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network's decoder says light, not colour: visibility of the prior, and what the prior does not know."""
from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import Channels
from ..progress import report
from .guides import FEATURES, GuideTensors, band_rows

LOBES = ("diffuse", "glossy", "transmission")
# RGB of each lobe, what no lobe explains, and a factor of the traced light
OUTPUTS = Channels(1, visibility=9, indirect=9, rest=3, traced=3)
MOST_TRACED = 4.0          # times, and its inverse at least: the factor of traced light
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
    traced = guides.traced * torch.exp(math.log(MOST_TRACED) * torch.tanh(raw[:, OUTPUTS["traced"]]))
    arriving = hinted * traced + (1 - hinted) * (direct * guides.colors).sum(1)
    return {"image": arriving + (indirect * guides.colors).sum(1) + rest, "direct": direct, "indirect": indirect,
            "rest": rest, "traced": traced}


def _softplus_inverse(y: Tensor) -> Tensor:
    y = y.clamp_min(2e-3)  # about softplus of DARK
    return y + torch.log(-torch.expm1(-y))


def decode_image(raw: Tensor, guides: GuideTensors) -> Tensor:
    """`image` of `decode_light`, in bands of bounded memory."""
    return decode_bands(raw, guides, ("image",))["image"]


def decode_bands(raw: Tensor, guides: GuideTensors, keys: Sequence[str]) -> dict[str, Tensor]:
    """The `keys` of `decode_light`, in bands of bounded memory."""
    bands, rows = [], band_rows(raw)
    pictures = (guides.features, guides.colors, guides.prior, guides.bounced, guides.behind, guides.reflected,
                guides.refracted, guides.traced)
    for band in zip(*(x.split(rows, dim=-2) for x in (raw, *pictures)), strict=True):
        report(len(bands) * rows / raw.shape[2])
        light = decode_light(band[0], GuideTensors(*band[1:4], guides.positions, *band[4:]))
        bands.append({key: light[key] for key in keys})
    return {key: torch.cat([band[key] for band in bands], dim=-2) for key in keys}
