# SPDX-License-Identifier: GPL-3.0-or-later
"""What guidance adds to the network: guides enter the ray bundles, light instead of colour leaves the decoder.

design.md, "The guided small preset". None of this exists in a model whose `ModelConfig.guided` is off.
"""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..network.inputs import NetworkInputs
from ..network.norm import Linear, RMSNorm
from .guides import ALPHA, BAND_PIXELS, FEATURES, PATCH, GuideTensors

BEAM_FEATURES = 5        # axis and two cosines of a light triangle's beam
OUTPUT_CHANNELS = 21     # visibility and indirect light of three lobes, and the rest, RGB each
MAX_VISIBILITY = 1.2     # the prior's glossy lobe is approximate: leave room above 1
VISIBLE, DARK = 1.5, -4.0  # offsets that start the decoder near "everything visible, nothing indirect"


class Guidance(nn.Module):
    """Embeds guides into ray-bundle tokens and beams into light tokens."""

    def __init__(self, dim: int, eps: float):
        super().__init__()
        self.bundle_encoder = Linear(FEATURES * PATCH * PATCH, dim)
        self.bundle_norm = RMSNorm(dim, eps)
        self.beam_encoder = Linear(BEAM_FEATURES, dim)

    def bundles(self, guides: GuideTensors) -> Tensor:
        """(V, B, D) added to the ray tokens."""
        def embed(features: Tensor) -> Tensor:
            patches = F.pixel_unshuffle(features, PATCH)
            return self.bundle_norm(self.bundle_encoder(patches.flatten(2).transpose(1, 2)))

        return torch.cat([embed(band) for band in guides.features.split(_band_rows(guides.features), dim=2)], dim=1)

    def beams(self, axis: Tensor, cosine: Tensor) -> Tensor:
        """(L, D) added to the tokens of L light triangles; axis (L, 3), cosine (L, 2)."""
        directed = (axis.square().sum(-1, keepdim=True) > 0.25).to(axis.dtype)
        return self.beam_encoder(torch.cat([axis, cosine], -1) * directed)


def encode_guided(network, inputs: NetworkInputs, beam_axis: Tensor, beam_cosine: Tensor, progress=None):
    """Stage 1 of a guided RenderFormer; beams (L, 3) and (L, 2) of the light triangles, in input order."""
    beams = network.guidance.beams(beam_axis, beam_cosine)
    return network.encode_scene(inputs, light_embedding=beams, progress=progress)


def view_guided(network, context, rays_o: Tensor, rays_d: Tensor, guides: GuideTensors, progress=None) -> Tensor:
    """Stage 2 and decoder of a guided RenderFormer: channels (V, 21, H, W) for `decode_light`."""
    return network.render_view(context, rays_o, rays_d, ray_embedding=network.guidance.bundles(guides),
                               ray_position=guides.positions, extra=guides.features, raw=True, progress=progress)


def decode_light(raw: Tensor, guides: GuideTensors) -> dict[str, Tensor]:
    """Decoder channels (V, 21, H, W) to radiance (V, 3, H, W) in network exposure.

    Keys: `image` (sum of all, without directly seen emitters and world), `direct` and `indirect` (V, 3, 3, H, W), the
    light of each lobe before its colour, and `rest` (volumes and whatever no lobe explains).
    """
    v, _, h, w = raw.shape
    raw = raw.float()
    visibility = MAX_VISIBILITY * torch.sigmoid(raw[:, 0:9] + VISIBLE).reshape(v, 3, 3, h, w)
    indirect = F.softplus(raw[:, 9:18] + DARK).reshape(v, 3, 3, h, w)
    rest = F.softplus(raw[:, 18:21] + DARK) * guides.features[:, ALPHA : ALPHA + 1]
    direct = guides.prior * visibility
    return {"image": ((direct + indirect) * guides.colors).sum(1) + rest, "direct": direct, "indirect": indirect,
            "rest": rest}


def decode_image(raw: Tensor, guides: GuideTensors, poll=None) -> Tensor:
    """`image` of `decode_light`, in bands of bounded memory; `poll()` is called before each and may raise."""
    rows = _band_rows(raw)
    bands = []
    for band in zip(*(x.split(rows, dim=-2) for x in (raw, guides.features, guides.colors, guides.prior))):
        if poll is not None:
            poll()
        bands.append(decode_light(band[0], GuideTensors(*band[1:], guides.positions))["image"])
    return torch.cat(bands, dim=2)


def _band_rows(picture: Tensor) -> int:
    """Rows of a band of (V, C, H, W), whole ray bundles; all with gradients."""
    views, _, height, width = picture.shape
    return height if torch.is_grad_enabled() else max(BAND_PIXELS // (views * width) // PATCH, 1) * PATCH
