# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.gain_map --data DIR --out DIR --minutes M: train the gain map of the bundled network alone.

All else of the network stays as it is in --start. First every sample is rendered with it once, into --cells, which
takes a second each and resumes; then the gain map learns from memory, many views at a time, and DIR/weights
holds the whole network. The learning rate falls to zero in the end.
"""
from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import torch
from torch import Tensor

from renderformer_v2.model.checkpoint import load_material_mapper, new_network, save_network
from renderformer_v2.model.fields import COLOR, DIRECTION, mapped_channels
from renderformer_v2.model.guided.gain_map import GainMap
from renderformer_v2.model.guided.light import SEEN, factor, shown
from renderformer_v2.model.presets import BUNDLED, PRESETS, weights_folder
from renderformer_v2.model.threads import team
from tools.arguments import whole_number

from .augment import recolored, turn_about_z
from .cells import CHANNELS, CellFiles, load_cells
from .errors import TrainingError
from .run import explained
from .start import start_from

VIEWS = 16             # at a time
LEARNING_RATE, WARM_UP = 2e-3, 50
WEIGHT_DECAY = 0.3
LEAST_ERROR = 1e-5     # mean square that counts as none
MEASURED = 500         # samples that tell means and deviations
TRUST = 0.8            # of what was learnt is written: other scenes are not quite like those of training
LOG_EVERY = 100        # steps


def decibels(gain: Tensor, before: Tensor, wanted: Tensor) -> Tensor:
    """(V,) by how much pictures (V, 3, h, w) come closer to what is wanted."""
    errors = ((shown(x) - shown(wanted)).square().mean((1, 2, 3)) + LEAST_ERROR for x in (before, before * gain))
    return 10 * (torch.log10(next(errors)) - torch.log10(next(errors)))


def augmented(cells: Tensor) -> Tensor:
    """Views (V, sum(CHANNELS), h, w) turned about Z, recoloured and mirrored, all alike."""
    order, turn = torch.randperm(3), turn_about_z(float(torch.rand(())) * 2 * torch.pi)
    seen, before, wanted = cells.split(CHANNELS, 1)
    seen = mapped_channels(seen, SEEN, {COLOR: recolored(order), DIRECTION: turn})
    cells = torch.cat([seen, before[:, order], wanted[:, order]], 1)
    for axis in (2, 3):
        if torch.rand(()) < 0.5:
            cells = cells.flip(axis)
    return cells.transpose(2, 3) if torch.rand(()) < 0.5 else cells


def train(gain_map: GainMap, samples: list[Tensor], seconds: float, write) -> None:
    """Fit a gain map to cells (V, C, h, w) of samples; `write()` is called in between and in the end."""
    by_shape: dict[tuple, list[Tensor]] = {}
    for sample in samples:
        by_shape.setdefault(sample.shape[2:], []).append(sample)
    most = max(by_shape.values(), key=len)
    gain_map.standardise(torch.cat([sample[:, :CHANNELS[0]].float() for sample in most[:MEASURED]]))
    shapes = [shape for shape, group in by_shape.items() for _ in group]
    fitted = [p for name, p in gain_map.named_parameters() if name not in ("scale", "offset")]
    optimizer = torch.optim.AdamW(fitted, LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    begin, step, gained = time.monotonic(), 0, []
    gain_map.train()
    while (left := 1 - (time.monotonic() - begin) / seconds) > 0:
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * min(1, (step + 1) / WARM_UP) * left
        group = by_shape[shapes[int(torch.randint(len(shapes), ()))]]
        chosen = (group[i] for i in torch.randint(len(group), (VIEWS,)).tolist())
        views = torch.stack([sample[int(torch.randint(len(sample), ()))] for sample in chosen])
        seen, before, wanted = augmented(views.float()).split(CHANNELS, 1)
        gain = decibels(factor(gain_map(seen)), before, wanted).mean()
        optimizer.zero_grad()
        (-gain).backward()
        optimizer.step()
        step, gained = step + 1, [*gained, float(gain.detach())]
        if step % LOG_EVERY == 0:
            print(f"step {step}: {sum(gained) / len(gained):.3f} dB gained", flush=True)
            gained = []
            write()
    write()


def fit(options: argparse.Namespace) -> None:
    """Raises TrainingError when there is nothing to learn from, or the weights are of another network."""
    torch.manual_seed(options.seed)
    network = new_network(PRESETS[BUNDLED]())
    start_from(network, weights_folder(options.start))
    network.gain_map.forget()
    network.eval().requires_grad_(False)
    files = CellFiles(options.data, options.cells or options.data.parent / "cells", network, load_material_mapper())
    samples = load_cells(files, options.processes or os.cpu_count() or 1)
    if not samples:
        raise TrainingError(f"{options.data} holds no samples that can be read: make some with tools.datagen")
    network.gain_map.requires_grad_(True)

    def write() -> None:
        state = network.state_dict()
        state |= {name: TRUST * tensor for name, tensor in state.items() if name.startswith("gain_map.leave.")}
        save_network(options.out / "weights", network.config, state)

    train(network.gain_map, samples, 60 * options.minutes, write)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.gain_map", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples")
    parser.add_argument("--start", default=BUNDLED, metavar="WEIGHTS_DIR", help=f"default: {BUNDLED}")
    parser.add_argument("--cells", type=Path, help="what is learnt from (default: DATA/../cells)")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, required=True, help="of training, after the samples were rendered")
    parser.add_argument("--processes", type=whole_number(0), default=0, help="that render (default: one per core)")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="that train (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with team(options.threads):
        return explained(lambda: fit(options))


if __name__ == "__main__":
    sys.exit(main())
