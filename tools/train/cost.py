# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.cost: what the paper's five stages cost, by formula and for so many cards.

A step of training is three times the operations of a forward pass (docs/network.md 12): the pass, and the gradients
with respect to what came in and to the weights. --rate is what a card really does, in operations per second. Its
default is a third of the 312e12 that the data sheet of an A100 promises for bfloat16; it is assumed, not measured.
"""
from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace

from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.weights.presets import rf2_200m
from tools.benchmark.flops import forward_flops
from tools.common.console import numbers

PASSES = 3
RATE = 312e12 / 3
CARDS = 32  # of the paper, which trained for `days` of each stage on so many
LIGHTS = 8


@dataclass(frozen=True)
class PaperStage:
    """A row of the paper's training process."""

    name: str
    triangles: int
    resolution: int
    dense: bool
    days: float


STAGES = (PaperStage("stage1", 1024, 256, True, 4), PaperStage("stage2", 4096, 512, True, 2),
          PaperStage("stage3", 4096, 512, False, 3), PaperStage("stage4", 16384, 512, False, 7),
          PaperStage("stage5", 65536, 2048, False, 3))


def training_flops(config: ModelConfig, triangles: int, resolution: int, *, dense: bool) -> int:
    """Operations for one scene and a view of it, forward and backward."""
    half = triangles if dense else config.local_attention_window_size_half
    flops = forward_flops(replace(config, local_attention_window_size_half=half), triangles, LIGHTS, resolution)
    return PASSES * sum(flops.values())


def tokens(config: ModelConfig, triangles: int, resolution: int) -> tuple[int, int]:
    """Tokens of a scene, and of a view of it."""
    return config.sequence_length(LIGHTS, triangles - LIGHTS), (resolution // config.patch_size) ** 2


def rows(cards: tuple[int, ...], rate: float) -> list[dict]:
    """A row for every stage: the cost of a scene, scenes in the paper's time, and the days that other cards take."""
    config, table = rf2_200m(), []
    for stage in STAGES:
        flops = training_flops(config, stage.triangles, stage.resolution, dense=stage.dense)
        scene, view = tokens(config, stage.triangles, stage.resolution)
        table.append({
            "stage": stage.name, "scene_tokens": scene, "view_tokens": view, "tflop_per_scene": round(flops / 1e12, 2),
            "tokens_per_second_and_card": round((scene + view) * rate / flops),
            "scenes_of_the_paper": round(stage.days * 86400 * CARDS * rate / flops),
            "days": {count: round(stage.days * CARDS / count, 1) for count in cards}})
    return table


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.cost", description=__doc__)
    parser.add_argument("--cards", type=numbers, default=(8, 32), help="default 8,32")
    parser.add_argument("--rate", type=float, default=RATE, metavar="FLOP/S", help=f"of a card (default {RATE:.3g})")
    options = parser.parse_args()
    for row in rows(options.cards, options.rate):
        print(json.dumps(row))
    return 0


if __name__ == "__main__":
    sys.exit(main())
