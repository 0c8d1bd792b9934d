# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.gain_map --data DIR --start WEIGHTS_DIR --out DIR --minutes M: train the gain map of a network.

All the rest of the network stays as it is. It renders every sample of DIR once (a second each), as small pictures that
are kept and read again by the next run; then the gain map learns from those in memory. The network with its new gain
map is written to --out/weights.
"""
from __future__ import annotations

import argparse
import sys

import torch
from torch import Tensor
from torch.nn import functional as F

from renderformer_v2.model.checkpoint import load_material_mapper, new_network, save_network
from renderformer_v2.model.fields import COLOR, DIRECTION, mapped_channels
from renderformer_v2.model.guided.decoding import SEEN, decode_light, factor, light_cells, shown
from renderformer_v2.model.guided.gain_map import GainMap, cell_side
from renderformer_v2.model.guided.network import GuidedRenderFormer
from renderformer_v2.model.presets import BUNDLED, PRESETS, weights_folder

from . import apart
from .augment import mirrored, recolored, turn_about_z
from .samples import TrainingSample, build_sample, with_latents
from .start import start_from

CHANNELS = len(SEEN), 3, 3  # what is seen, radiance as it is, and as it should be
VIEWS = 16             # at a time
WEIGHT_DECAY = 0.3
MEASURED = 500         # samples that tell means and deviations
TRUST = 0.8            # of what was learnt is written: other scenes are not quite like those of training


def cells(network: GuidedRenderFormer, sample: TrainingSample) -> Tensor:
    """(V, sum(CHANNELS), h, w) of all views of a scene under a network whose gain map changes nothing."""
    guides = sample.view.guides
    raw = network.render_view(network.encode_scene(sample.inputs), sample.view)
    radiance = torch.cat([decode_light(raw, guides)["image"], sample.image], 1)
    return torch.cat([light_cells(raw, guides), F.avg_pool2d(radiance, cell_side(*raw.shape[2:]))], 1)


def augmented(views: Tensor) -> Tensor:
    """Cells (V, sum(CHANNELS), h, w) turned about Z, recoloured and mirrored, all alike."""
    order, turn = torch.randperm(3), turn_about_z(float(torch.rand(())) * 2 * torch.pi)
    seen, before, wanted = views.split(CHANNELS, 1)
    seen = mapped_channels(seen, SEEN, {COLOR: recolored(order), DIRECTION: turn})
    return mirrored(torch.cat([seen, before[:, order], wanted[:, order]], 1))


def train(gain_map: GainMap, samples: list[Tensor], seconds: float, write) -> None:
    """Fit a gain map to cells (V, C, h, w) of samples; `write()` is called in between and in the end."""
    by_shape: dict[tuple, list[Tensor]] = {}
    for sample in samples:
        by_shape.setdefault(sample.shape[2:], []).append(sample)
    most = max(by_shape.values(), key=len)
    gain_map.standardise(torch.cat([sample[:, :CHANNELS[0]].float() for sample in most[:MEASURED]]))
    gain_map.scale.requires_grad_(False)
    gain_map.offset.requires_grad_(False)
    shapes = [shape for shape, group in by_shape.items() for _ in group]

    def gained() -> Tensor:
        group = by_shape[shapes[int(torch.randint(len(shapes), ()))]]
        chosen = (group[i] for i in torch.randint(len(group), (VIEWS,)).tolist())
        views = torch.stack([sample[int(torch.randint(len(sample), ()))] for sample in chosen])
        seen, before, wanted = augmented(views.float()).split(CHANNELS, 1)
        return apart.decibels(shown(before * factor(gain_map(seen))), shown(before), shown(wanted))

    apart.gain_decibels(gain_map, gained, seconds, WEIGHT_DECAY, write)


def fit(options: argparse.Namespace) -> None:
    """Raises TrainingError when there is nothing to learn from, or the weights are of another network."""
    torch.manual_seed(options.seed)
    network, mapper = new_network(PRESETS[BUNDLED]()), load_material_mapper()
    start_from(network, weights_folder(options.start))
    network.gain_map.forget()
    network.eval().requires_grad_(False)
    samples = apart.rendered(options, network, ("gain_map", "kernel_predictor"),
                             lambda path: cells(network, with_latents(build_sample(path), mapper)))
    network.gain_map.requires_grad_(True)

    def write() -> None:
        state = network.state_dict()
        state |= {name: TRUST * tensor for name, tensor in state.items() if name.startswith("gain_map.leave.")}
        save_network(options.out / "weights", network.config, state)

    train(network.gain_map, samples, 60 * options.minutes, write)


def main() -> int:
    return apart.command("gain_map", __doc__, fit)


if __name__ == "__main__":
    sys.exit(main())
