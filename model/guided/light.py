# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network's decoder says light, not colour: visibility of the prior, and what the prior does not know."""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import Channels
from ..progress import report
from .guides import FEATURES, GuideTensors, band_rows

LOBES = ("diffuse", "glossy", "transmission")
OUTPUTS = Channels(1, visibility=9, indirect=9, rest=3)  # RGB of each lobe, and what no lobe explains
MAX_VISIBILITY = 1.2       # the prior's glossy lobe is approximate: leave room above 1
VISIBLE, DARK = 1.5, -4.0  # offsets that start the decoder near "everything visible, nothing indirect"


def decode_light(raw: Tensor, guides: GuideTensors) -> dict[str, Tensor]:
    """Decoder channels (V, len(OUTPUTS), H, W) to radiance (V, 3, H, W) in network exposure.

    Keys: `image` (sum of all, without directly seen emitters and world), `direct` and `indirect` (V, 3, 3, H, W), the
    light of each lobe before its colour, and `rest` (volumes and whatever no lobe explains).
    """
    v, _, h, w = raw.shape
    raw = raw.float()
    visibility = MAX_VISIBILITY * torch.sigmoid(raw[:, OUTPUTS["visibility"]] + VISIBLE).reshape(v, 3, 3, h, w)
    indirect = F.softplus(raw[:, OUTPUTS["indirect"]] + DARK).reshape(v, 3, 3, h, w)
    rest = F.softplus(raw[:, OUTPUTS["rest"]] + DARK) * guides.features[:, FEATURES["alpha"]]
    direct = guides.prior * visibility
    return {"image": ((direct + indirect) * guides.colors).sum(1) + rest, "direct": direct, "indirect": indirect,
            "rest": rest}


def decode_image(raw: Tensor, guides: GuideTensors) -> Tensor:
    """`image` of `decode_light`, in bands of bounded memory."""
    bands, rows = [], band_rows(raw)
    for band in zip(*(x.split(rows, dim=-2) for x in (raw, guides.features, guides.colors, guides.prior))):
        report(len(bands) * rows / raw.shape[2])
        bands.append(decode_light(band[0], GuideTensors(*band[1:], guides.positions))["image"])
    return torch.cat(bands, dim=2)
