# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the surfaces that mirrors and glass show, at pixels."""
from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...scene import Guides
from ..hit_surfaces import tensors_on
from ..probes import Probes


def path_end_light(lobe: str, guides: Guides, make_probes: Callable[..., Probes], outgoing: Callable[..., Tensor],
                   filters: Iterable[int], device: torch.device) -> tuple[Tensor, Tensor]:
    """(h, W, 3) radiance from the surfaces at which specular paths end, tinted, and (h, W, 1) bool where they meet any.

    lobe: "reflected" or "refracted". outgoing(position, normal, number): (P, 3) radiance of white diffuse surfaces.
    """
    to_tensor = tensors_on(device)
    arrays = [getattr(guides, f"{lobe}_{kind}") for kind in ("position", "normal", "color")]
    if arrays[0] is None:
        dark = to_tensor(np.zeros_like(guides.position))
        return dark, dark[..., :1] > 0
    position, normal, color = map(to_tensor, arrays)
    is_lit = color.amax(-1, keepdim=True) > 0
    probes = make_probes(position, F.normalize(normal, dim=-1), is_lit)
    light = probes.interpolate(lambda x, n, number: {"light": outgoing(x, n, number)}, filters=filters)["light"]
    return light * color, (normal != 0).any(-1, keepdim=True)
