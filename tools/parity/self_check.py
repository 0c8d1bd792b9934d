# SPDX-License-Identifier: GPL-3.0-or-later
"""The numeric self-checks of docs/network.md 14 and the check of the weights recipe."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch.nn import functional as F

from renderformer_v2.model.camera import square_view, view_rays
from renderformer_v2.model.environment import direction_map
from renderformer_v2.model.network.attention import SHIFT, shift_mask, to_windows
from renderformer_v2.model.network.banded import resize
from renderformer_v2.model.network.block_attention import KeysValues, Window
from renderformer_v2.model.network.decoder import DPTDecoder
from renderformer_v2.model.network.embedding import patches, resize_texture
from renderformer_v2.model.network.inputs import encode_light
from renderformer_v2.model.network.layers import RMSNorm, RotaryEmbedding, SwiGLU, nerf_encode, rope_frequencies
from renderformer_v2.model.network.renderformer import RenderFormer, to_radiance
from renderformer_v2.model.network.sequence import (
    Tokens,
    centroids,
    hilbert_codes,
    hilbert_grid,
    hilbert_order,
    pack,
    scene_centre,
)
from renderformer_v2.model.progress import steps
from renderformer_v2.model.weights.presets import rf2_200m

from .cases import Recorder, recipe_tensor, relative_error


def self_check(checks: dict) -> Iterator[tuple[str, float]]:
    """(name, error) of every entry; `checks` is selfcheck.json."""
    for name, entry in checks.items():
        short = name.split("_")[0]
        if short not in _CHECKS:
            yield name, float("inf")
            continue
        pairs = list(_CHECKS[short](entry))
        yield name, max(relative_error(torch.as_tensor(a), torch.as_tensor(b).to(torch.as_tensor(a).dtype))
                        for a, b in pairs)


def weights_check(table: dict) -> Iterator[tuple[str, float]]:
    """(name, error) of every tensor; `table` is weights_check.json."""
    for preset, tensors in table.items():
        for key, entry in tensors.items():
            tensor = recipe_tensor(key, tuple(entry["shape"]))
            yield f"{preset}.{key}", _sampled(tensor, entry["first"], entry.get("sum"))


def _sampled(tensor: torch.Tensor, first: list[float], total: float | None) -> float:
    error = relative_error(tensor.flatten()[:len(first)].double(), torch.tensor(first, dtype=torch.float64))
    if total is None:
        return error
    # A sum may cancel to almost nothing, so its error is measured against the sum of magnitudes.
    return max(error, abs(tensor.double().sum().item() - total) / tensor.double().abs().sum().item())


def _at(tensor: torch.Tensor, samples: dict) -> tuple[torch.Tensor, list]:
    return tensor[[int(i) for i in samples]], list(samples.values())


def _nerf(entry):
    yield nerf_encode(torch.tensor(entry["x"]), entry["n"]), entry["out"]


def _nerf_samples(entry):
    encoded = nerf_encode(0.01 * torch.arange(9) - 0.03, 12)
    yield encoded.shape[0], entry["dim"]
    yield _at(encoded, entry["samples"])


def _nerf_width(entry):
    yield nerf_encode(torch.zeros(9), 6).shape[0], entry


def _nerf_identity(entry):
    yield nerf_encode(torch.tensor([0.1, 0.2, 0.3]), 0), entry


def _rms_norm(entry):
    with torch.no_grad():
        yield RMSNorm(4)(torch.tensor(entry["x"])), entry["out"]
        yield RMSNorm(4, entry["eps_default"])(torch.tensor(entry["small"])), entry["small_eps_default"]
        yield RMSNorm(4)(torch.tensor(entry["small"])), entry["small_eps_1e6"]


def _hilbert_codes(entry):
    yield hilbert_codes(torch.tensor(entry["points"])), entry["codes"]


def _hilbert_corner(entry):
    for side, points in ((2, entry["order"]), (4, entry["depth2_first16"])):
        cells = torch.cartesian_prod(*[torch.arange(side)] * 3)
        # A coarse curve is the fine one read at the cells' corners, so scale to the full depth.
        order = hilbert_codes(cells * (65536 // side)).argsort()
        yield cells[order][:len(points)], points


def _hilbert_order(entry):
    points = torch.tensor(entry["points"])
    yield hilbert_grid(points), entry["grid"]
    yield hilbert_codes(hilbert_grid(points)), entry["codes"]
    yield hilbert_order(points), entry["order"]


def _hilbert_planar(entry):
    points = torch.tensor(_POINTS)
    points[:, 2] = 0.25
    yield hilbert_order(points), entry["order"]


def _rope_frequencies(entry):
    yield rope_frequencies(40), entry


def _rope_small(entry):
    rope = RotaryEmbedding(entry["dim"], entry["head_dim"])
    x = torch.arange(entry["head_dim"]) / 10
    yield rope.freqs.data, entry["freqs"]
    yield rope(torch.tensor(entry["pos"]))(x[None])[0], entry["out"]


def _rope_wide(entry):
    x = torch.cos(0.37 * torch.arange(128))
    turned = RotaryEmbedding(40, 128)(torch.tensor(entry["pos"]))(x[None])[0]
    yield _at(turned, entry["out_samples"])
    yield turned[entry["unrotated"]], x[entry["unrotated"]]


def _register(entry):
    triangles = torch.tensor(entry["triangles"]).view(-1, 3, 3)
    yield centroids(triangles).flatten(), entry["centroids"]
    yield scene_centre(triangles), entry["register"]


def _visible(length: int, sink: int, half: int) -> torch.Tensor:
    """(L, L) bool, read off the attention itself: equal scores give every visible key the same weight."""
    return window_sink_attention(torch.zeros(length, 1, 8), torch.zeros(length, 1, 8), torch.eye(length)[:, None],
                                 sink, half)[0] > 0


def window_sink_attention(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, sink: int, half: int) -> torch.Tensor:
    """A whole sequence, piece by piece as stage 1 does it. (L, heads, width) each -> (heads, L, width)."""
    window = Window(len(q), sink, half, q.device)
    keys = KeysValues.collect(lambda rows: (k[rows], v[rows]), window.pieces, k.device)
    queries = q.transpose(0, 1)
    return torch.cat([window.attend(queries[:, rows], keys, rows.start) for rows in steps(window.pieces)], dim=1)


def _mask_rows(entry):
    for row, keys in zip(_visible(12, 3, 2), entry):
        yield row.nonzero()[:, 0], keys


def _mask_counts(entry):
    counts = _visible(1339, 102, 256).sum(dim=1)
    yield _at(counts, entry)


def _packing(entry):
    values = torch.tensor([float(k * k) for k in range(1, 9)])
    embedding = torch.stack([values, torch.zeros(8)], dim=1)
    positions = torch.tensor(_POINTS[:8])
    triangles = Tokens(embedding[:6], positions[:6], torch.arange(6))
    is_light = torch.arange(6) == 1
    register = Tokens.at(torch.tensor([[100.0, 0.0]]), torch.zeros(3))
    volume = Tokens.at(embedding[6:7], positions[6:7])
    sequence, sink = pack([register], triangles, is_light, [volume], 2, torch.tensor([0.0, 0.5]))
    yield sequence.embedding, entry["seq"]
    yield sequence.triangle, entry["tri_id"]
    yield sequence.position, entry["pos"]
    yield [sink], entry["sink"]


def _swin_mask(entry):
    yield shift_mask((8, 8)).sum(), entry["grid8x8_shift4"]["true_total"]
    yield shift_mask((8, 8))[0, 0].nonzero()[:, 0], entry["grid8x8_shift4"]["row0_true"]
    for grid in ((16, 16), (16, 24)):
        yield shift_mask(grid).sum(dim=(1, 2)), entry[f"grid{grid[0]}x{grid[1]}"]["true_per_window"]


def _swin_regions(entry):
    regions = torch.tensor(entry)
    windows = to_windows(regions.repeat_interleave(4, 0).repeat_interleave(4, 1)[None, :, :, None])[..., 0]
    yield shift_mask((16, 16)).long(), (windows[:, :, None] == windows[:, None, :]).long()


def _swin_windows(entry):
    ids = torch.arange(256).view(1, 16, 16, 1).roll((-SHIFT, -SHIFT), dims=(1, 2))
    windows = to_windows(ids)[..., 0]
    yield windows[:, [0, 1, 8, 63]], entry["first_last"]


def _rays(entry):
    yield view_rays(square_view(np.eye(4), 90, 2))[1].reshape(4, 3), entry


def _rays_look_at(entry):
    directions = view_rays(square_view(np.array(entry["c2w"]), entry["fov_deg"], entry["res"]))[1]
    for row, column in ((0, 0), (0, 7), (5, 2)):
        yield directions[row, column], entry[f"pixel_{row}_{column}"]


def _ray_patch(entry):
    rows, columns, channels = torch.meshgrid(*map(torch.arange, (16, 16, 3)), indexing="ij")
    tokens = patches((48 * rows + 3 * columns + channels).float().permute(2, 0, 1)[None], 8)[0]
    yield _at(tokens[1], entry["token1_entries"])
    yield tokens[2, 0], float(entry["token2_entry0"])


def _environment_patch(entry):
    channels, rows, columns = torch.meshgrid(*map(torch.arange, (16, 32, 64)), indexing="ij")
    tokens = patches((2048 * channels + 64 * rows + columns).float()[None], 8)
    yield list(tokens.shape), entry["shape"]
    yield _at(tokens[0, 9], entry["token9_entries"])


def _directions(entry):
    for place, direction in entry.items():
        row, column = map(int, place.split(","))
        yield direction_map(256, 512)[row, column], direction


def _light(entry):
    encoded = encode_light(torch.tensor(entry["strength"], dtype=torch.float32))
    yield encoded, entry["encoded"]
    yield encoded > 0, entry["is_light"]


def _elu(entry):
    y = F.elu(torch.tensor(entry["x"], dtype=torch.float32), alpha=0.001)
    yield y, entry["y"]
    yield to_radiance(y), entry["linear"]


def _resize(entry):
    for source, target, count in (("x", "to6", 6), ("x2", "to4", 4)):
        line = torch.tensor(entry[source], dtype=torch.float32)[None, None, None]
        yield resize(line, (1, count))[0, 0, 0], entry[target]


def _swiglu(entry):
    layer = SwiGLU(2, 2)
    layer.load_state_dict({"w1.weight": torch.tensor([[1., 2.], [0., -1.]]),
                           "w3.weight": torch.tensor([[1., 1.], [2., 0.]]),
                           "w2.weight": torch.tensor([[1., -1.], [0.5, 0.25]])})
    with torch.no_grad():
        yield layer(torch.tensor([0.5, -1.5])), entry["out"]


def _gelu(entry):
    yield F.gelu(torch.tensor(entry["x"], dtype=torch.float32)), entry["y"]


def _tile(entry):
    yield resize_texture(torch.arange(64.0).view(1, 1, 8, 8), 4).flatten()[:len(entry)], entry


def _decoder_sizes(entry):
    with torch.device("meta"):
        decoder = DPTDecoder(rf2_200m())
    for name, sizes in entry.items():
        grid = tuple(map(int, name.split("x")))
        parts = dict(decoder.scratch.named_children())
        with Recorder(parts | {"output_conv2": parts["output_conv2"][-1]}) as record:
            decoder([torch.zeros(1, 768, *grid, device="meta")] * 4)
        for key, size in sizes.items():
            yield list(record[key].shape[-2:]), size


def _recipe(entry):
    with torch.device("meta"):
        shapes = {k: tuple(v.shape) for k, v in RenderFormer(rf2_200m()).state_dict().items()}
    for key, expected in entry.items():
        yield _sampled(recipe_tensor(key, shapes[key]), expected["first3"], expected["sum"]) < 1e-4, True


def _qk_norm(entry):
    with torch.no_grad():
        normed = RMSNorm(4)(torch.tensor(entry["x"]))
    yield normed, entry["normed"]
    yield normed.unflatten(-1, (2, -1)), [entry["head0"], entry["head1"]]


def _counts(entry):
    with torch.device("meta"):
        yield sum(p.numel() for p in RenderFormer(rf2_200m()).parameters()), entry["full"]


_POINTS = [[0.1, 0.2, 0.3], [-0.4, 0, 0.25], [0.5, -0.5, 0.1], [0.45, 0.4, -0.3], [-0.2, -0.1, 0], [0, 0.3, 0.3],
           [-0.5, 0.5, -0.5], [0.2, 0.2, 0.2], [0.15, -0.35, 0.45], [-0.05, 0.05, -0.15]]
_CHECKS = {
    "01": _nerf, "02": _nerf_samples, "02b": _nerf_width, "02c": _nerf_identity, "03": _rms_norm,
    "04": _hilbert_codes, "04b": _hilbert_corner, "05": _hilbert_order, "06": _hilbert_planar,
    "07": _rope_frequencies, "08": _rope_small, "09": _rope_wide, "10": _register, "11": _mask_rows,
    "11b": _mask_counts, "12": _packing, "13": _swin_mask, "13b": _swin_regions, "14": _swin_windows, "15": _rays,
    "15b": _rays_look_at, "16": _ray_patch, "17": _environment_patch, "18": _directions, "19": _light, "20": _elu,
    "21": _resize, "22": _swiglu, "23": _gelu, "24": _tile, "25": _decoder_sizes, "26": _recipe, "27": _qk_norm,
    "28": _counts,
}
