# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.throughput: tokens that a training step takes a second on this device, without any data.

Forward pass, gradients and optimiser, with random weights, latents and pictures; the scenes have the geometry of
tools.benchmark. Prints one line of JSON; `flop_per_second` goes into tools.train.cost --rate.
"""
from __future__ import annotations

import argparse
import json
import statistics
import sys
import time

import torch

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.compute.precision import NAMES
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.inputs import view_inputs
from renderformer_v2.model.weights.presets import rf2_200m
from renderformer_v2.rf2_engine.progress import memory
from tools.benchmark import ring
from tools.benchmark.point import random_inputs
from tools.common.console import whole_number

from .config import set_attention
from .cost import tokens, training_flops
from .losses import paper_loss, structure_loss
from .run import add_precision, compile_parts, training_precision
from .state import TrainingState


def measure(config: ModelConfig, options: argparse.Namespace) -> dict:
    """Seconds of a step with one scene and one view, the median of some after a first one."""
    device = torch.device(options.device)
    precision = training_precision(options.precision, device)
    torch.manual_seed(0)
    network = new_network(config).to(device).train()
    set_attention(network, dense=options.dense)
    if options.compile:
        compile_parts(network)
    state = TrainingState(network, 1e-4, 0.01, 0.999)
    inputs = random_inputs(options.triangles, config).to(device)
    rays = view_inputs(square_view(ring.camera_to_world(), ring.FIELD_OF_VIEW, options.resolution)).to(device)
    target = torch.rand(1, 3, options.resolution, options.resolution, device=device)
    seconds = []
    for _ in range(options.steps + 1):
        begin = time.perf_counter()
        with torch.autocast(device.type, precision, enabled=precision != torch.float32):
            loss = paper_loss(network(inputs, rays), target, structure_loss)
        loss.backward()
        state.advance(1e-4, 1.0)
        float(loss.detach())  # waits for a card
        seconds.append(time.perf_counter() - begin)
    step, count = statistics.median(seconds[1:]), len(inputs.light)
    flops = training_flops(config, count, options.resolution, dense=options.dense)
    return {"device": str(device), "triangles": count, "resolution": options.resolution, "dense": options.dense,
            "precision": NAMES[precision], "seconds": round(step, 3),
            "tokens_per_second": round(sum(tokens(config, count, options.resolution)) / step),
            "tflop": round(flops / 1e12, 3), "flop_per_second": round(flops / step),
            "threads": torch.get_num_threads() if device.type == "cpu" else None,
            "memory_mib": round(memory.measure()[1] if device.type == "cpu" else
                                torch.cuda.max_memory_allocated() / memory.MEBI)}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.throughput", description=__doc__)
    parser.add_argument("--triangles", type=whole_number(ring.LEAST), default=1024)
    parser.add_argument("--resolution", type=whole_number(64), default=256)
    parser.add_argument("--dense", action="store_true", help="without the window, as in the paper's stages 1 and 2")
    parser.add_argument("--steps", type=whole_number(1), default=3)
    add_precision(parser)
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=whole_number(0), default=0)
    options = parser.parse_args()
    with team(options.threads):
        print(json.dumps(measure(rf2_200m(), options)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
