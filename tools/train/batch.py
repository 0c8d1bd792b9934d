# SPDX-License-Identifier: GPL-3.0-or-later
"""Several scenes in one pass of the guided network, padded to one length: a card computes them as fast as one.

Workers find out on the CPU where each token of the padded sequences comes from, so that the card never waits for a
count. The numbers are those of `GuidedRenderFormer`, scene by scene.
"""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F
from torch.nn.utils.rnn import pad_sequence

from renderformer_v2.model.guided.guided_inputs import GuidedInputs
from renderformer_v2.model.guided.light_attention import Surfaces
from renderformer_v2.model.guided.network import GuidedRenderFormer
from renderformer_v2.model.network.attention import Attention
from renderformer_v2.model.network.config import ENVIRONMENT_GRID, ModelConfig
from renderformer_v2.model.network.inputs import EnvironmentInputs
from renderformer_v2.model.network.renderformer import arranged
from renderformer_v2.model.tensor_group import TensorGroup, stacked

from .sample_cache import stored
from .samples import TrainingSample

MULTIPLE = 8  # tokens, of a sequence's length: what attention with a mask is fast with


@dataclass
class Batch(TensorGroup):
    """B scenes with V views each, all of one size.

    `sample` holds the rows and views of all scenes, one scene behind the other, and a panorama of each. Sequences are
    padded to L tokens, and the rows that these come from are counted in: registers, environments, triangles, volume
    cells, summaries.
    """

    sample: TrainingSample
    rows: Tensor       # (B, L) int64
    positions: Tensor  # (B, L, 3) f32
    sink: Tensor       # (B,) int64, tokens of the sink
    length: Tensor     # (B,) int64, tokens without padding
    triangle: Tensor   # (B, L) int64, row of the triangle that a token stands for, else -1
    blocks: Tensor     # (S, summary_block_size) int64, rows of which each of the S summaries is the mean

    def __len__(self) -> int:
        return len(self.rows)

    def stored(self) -> Batch:
        """The batch in half precision where prepared samples are, to be moved."""
        return each_field(self, stored)

    def restored(self) -> Batch:
        """The batch in float32 again."""
        return each_field(self, lambda value, _: value.float() if value.is_floating_point() else value)


def each_field(group: TensorGroup, change: Callable[[Tensor, str], Tensor]) -> TensorGroup:
    """A copy in which every tensor, those of inner groups too, is change(tensor, its field's name)."""
    values = {f.name: getattr(group, f.name) for f in fields(group)}
    return type(group)(**{name: change(value, name) if isinstance(value, Tensor) else
                          None if value is None else each_field(value, change) for name, value in values.items()})


class Batching(NamedTuple):
    """How samples are put together."""

    size: int                       # scenes of a batch
    config: ModelConfig             # of the network
    lengths: tuple[int, ...] = ()   # to which sequences are padded, those of a batch to one; longer ones stay longer


def batches(samples: Iterable, batching: Batching) -> Iterator:
    """Batches of samples whose views are equal in number and size, in the order in which they are complete.

    They are `stored`, and have to be `restored`.
    What is no sample, a problem that a stream yields, is passed on.
    """
    size, config, lengths = batching
    waiting: dict[tuple, list[TrainingSample]] = {}
    for sample in samples:
        if not isinstance(sample, TrainingSample):
            yield sample
            continue
        length = padded_length(sample.inputs, config, lengths)
        group = waiting.setdefault((sample.image.shape, length), [])
        group.append(sample)
        if len(group) == size:
            yield joined(group, config, length).stored()
            group.clear()


def padded_length(scene: GuidedInputs, config: ModelConfig, lengths: tuple[int, ...]) -> int | None:
    """The least of `lengths` that a scene's sequence fits into."""
    lights = len(scene.beam_axis)
    length = config.sequence_length(lights, len(scene.triangles) - lights + _cells(scene))
    return min((most for most in lengths if most >= length), default=None)


def joined(samples: list[TrainingSample], config: ModelConfig, padded: int | None = None) -> Batch:
    """One batch of samples with views of equal number and size, whose sequences are `padded` to a length."""
    inputs = [sample.inputs for sample in samples]
    registers, block = config.num_register_tokens, config.summary_block_size
    grid = 2 * ENVIRONMENT_GRID[0] * ENVIRONMENT_GRID[1]  # LDR and HDR
    first_triangle = triangle = registers + len(samples) * grid
    cell = triangle + sum(len(scene.triangles) for scene in inputs)
    summary = cell + sum(_cells(scene) for scene in inputs)
    rows, positions, triangles, sinks, blocks = [], [], [], [], []
    for i, scene in enumerate(inputs):
        # The embedding of a token is its row; that of a summary is no number.
        sequence, first = arranged(
            scene, config, _column(0, registers), _column(registers + i * grid, grid),
            _column(triangle, len(scene.triangles)), _column(cell, _cells(scene)) if _cells(scene) else None,
            torch.full((1, 1), torch.nan))
        row = sequence.embedding[:, 0]
        is_summary = row.isnan()
        count = int(is_summary.sum())
        row[is_summary] = torch.arange(summary, summary + count, dtype=row.dtype)
        rows.append(row.long())
        blocks.append(rows[-1][first:first + count * block].view(count, block))
        positions.append(sequence.position)
        triangles.append(torch.where(sequence.triangle < 0, -1, sequence.triangle + triangle - first_triangle))
        sinks.append(first if config.sinks else 0)
        triangle, cell, summary = triangle + len(scene.triangles), cell + _cells(scene), summary + count
    length = torch.tensor([len(row) for row in rows])
    longest = int(length.max())
    padding = -longest % MULTIPLE if padded is None else padded - longest
    views = {f.name: torch.cat([getattr(sample, f.name) for sample in samples])
             for f in fields(TrainingSample) if f.name not in ("inputs", "view")}
    return Batch(TrainingSample(_joined_inputs(inputs), stacked([sample.view for sample in samples]), **views),
                 F.pad(pad_sequence(rows, True), (0, padding)),
                 F.pad(pad_sequence(positions, True), (0, 0, 0, padding)), torch.tensor(sinks), length,
                 F.pad(pad_sequence(triangles, True, -1), (0, padding), value=-1), torch.cat(blocks))


def _column(first: int, count: int) -> Tensor:
    """(count, 1) f64: rows of a batch, beginning with `first`."""
    return torch.arange(first, first + count, dtype=torch.float64)[:, None]


def _cells(scene: GuidedInputs) -> int:
    return 0 if scene.volumes is None else len(scene.volumes.position)


def _joined_inputs(inputs: list[GuidedInputs]) -> GuidedInputs:
    first, index = 0, []
    for scene in inputs:
        index.append(scene.texture_index + first)
        first += len(scene.texture)
    environments = [scene.environment for scene in inputs]
    volumes = [scene.volumes for scene in inputs if scene.volumes is not None]
    apart = {f.name: torch.stack([getattr(e, f.name) for e in environments]) for f in fields(EnvironmentInputs)}
    behind = {name: torch.cat([getattr(scene, name) for scene in inputs])
              for name in ("triangles", "normals", "texture", "light", "beam_axis", "beam_cosine", "sent")}
    return GuidedInputs(**behind, texture_index=torch.cat(index), environment=EnvironmentInputs(**apart),
                        volumes=stacked(volumes) if volumes else None)


def render_batch(model: GuidedRenderFormer, tokens: Tensor, batch: Batch) -> Tensor:
    """`render_view(encode_scene(...))` of every scene, whose tokens `embed` made: (B V, C, H, W), what the network's
    `decode` returns."""
    return gather_light(model, spread_light(model, tokens, batch), batch)


def embed(model: GuidedRenderFormer, batch: Batch) -> Tensor:
    """Tokens before stage 1, (B, L, D) float32."""
    inputs = batch.sample.inputs
    environments = model.embed_environment(inputs.environment).flatten(0, 1)
    groups = [model.reg_tokens[0], environments, model.embed_triangles(inputs)]
    if inputs.volumes is not None:
        groups.append(model.volume_encoder(inputs.volumes))
    rows = torch.cat([group.float() for group in groups])
    summaries = F.embedding(batch.blocks, rows).mean(1) + model.transformer.summary_token_embed.float()[0]
    return F.embedding(batch.rows, torch.cat([rows, summaries]))


def spread_light(model: GuidedRenderFormer, tokens: Tensor, batch: Batch) -> Tensor:
    """Stage 1, (B, L, D) float32."""
    stage = model.transformer
    rotation, mask = stage.rope_emb(batch.positions), stage_1_mask(batch, stage.half)
    for layer in stage.layers:
        x, attention = layer.query_norm(tokens), layer.multihead_attn
        tokens = tokens + attend(attention, attention.queries(x, rotation), attention.keys_values(x, rotation), mask)
        tokens = tokens + layer.ffn(layer.ffn_norm(tokens))
    return tokens


def gather_light(model: GuidedRenderFormer, tokens: Tensor, batch: Batch) -> Tensor:
    """Stage 2 and the decoder."""
    view, stage, side = batch.sample.view, model.view_transformer.transformer, model.config.patch_size
    grid = [size // side for size in view.directions.shape[1:3]]
    positions = model.ray_positions(view).unflatten(0, (len(batch), -1)).flatten(1, 2)
    of_rays, of_tokens = stage.rope_emb(positions), stage.rope_emb(batch.positions)
    mask = is_token(batch)[:, None, None].expand(-1, 1, positions.shape[1], -1)
    rays = model.embed_rays(view)
    rays = rays + model.found_light(rays, view, Surfaces.of(tokens, batch.triangle, batch.sample.inputs))
    rays, features = rays.unflatten(1, grid), {}
    for i, layer in enumerate(stage.layers):
        attention, x = layer.multihead_attn, rays.view(len(batch), -1, rays.shape[-1])
        keys_values = attention.keys_values(layer.kv_norm(tokens), of_tokens)
        x = x + attend(attention, attention.queries(layer.query_norm(x), of_rays), keys_values, mask)
        rays = x.view(rays.shape)
        rays = rays + layer.self_attn(rays, layer.self_attn_norm)
        rays = rays + layer.ffn(layer.ffn_norm(rays))
        features[i] = rays.permute(0, 3, 1, 2)
    return model.decode(model.say(features[model.config.decoder_layers[-1]], view), view)


def attend(attention: Attention, queries: Tensor, keys_values: tuple[Tensor, Tensor], mask: Tensor) -> Tensor:
    """(B, n, heads, width) queries, keys and values, of which `mask` (B, 1, n, m) shows some -> (B, n, D)."""
    q, k, v = (x.transpose(1, 2) for x in (queries, *keys_values))
    bias = torch.zeros(mask.shape, dtype=q.dtype, device=q.device).masked_fill_(~mask, -torch.inf)
    return attention.out_proj(F.scaled_dot_product_attention(q, k, v, attn_mask=bias).transpose(1, 2).flatten(2))


def is_token(batch: Batch) -> Tensor:
    """(B, L) bool: not padding."""
    return torch.arange(batch.rows.shape[1], device=batch.rows.device) < batch.length[:, None]


def stage_1_mask(batch: Batch, half: int | None) -> Tensor:
    """(B, 1, L, L) bool: which keys a query sees, as `block_attention.Window` has it."""
    place = torch.arange(batch.rows.shape[1], device=batch.rows.device)
    visible = is_token(batch)[:, None]
    if half is not None:
        is_near = (place[:, None] - place).abs() <= half
        in_sink = place < batch.sink[:, None]
        visible = visible & (is_near | in_sink[:, None] | in_sink[:, :, None])
    return visible.expand(-1, len(place), -1)[:, None]
