# SPDX-License-Identifier: GPL-3.0-or-later
"""The training loop: so many minutes of steps, with a diary, and saved so that another run goes on from there."""
from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import torch
from torch import Tensor

from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.threads import team
from tools.arguments import whole_number

from .config import TrainConfig
from .errors import TrainingError
from .log import Log
from .state import TrainingState

LOG_EVERY = 50  # steps


def run(state: TrainingState, config: TrainConfig, options: argparse.Namespace, scenes: Iterator,
        losses_of: Callable[..., dict[str, Tensor]], write_weights: Callable[[], None]) -> None:
    """Go on from what `options.out` holds, for `options.minutes`.

    scenes: endless samples, asked for after the state is restored. losses_of(sample): losses on the sample's device,
    the one to minimise under "total". write_weights: saves the running average for rendering.
    Raises TrainingError when training has gone wrong.
    """
    device, saved = torch.device(options.device), options.out / "state.safetensors"
    options.out.mkdir(parents=True, exist_ok=True)
    state.resume(saved)
    print(f"{sum(p.numel() for p in state.model.parameters()):,} parameters, step {state.step}", flush=True)
    log, begin = Log(options.out / "log.jsonl"), time.monotonic()
    last_save, seconds, cooldown = begin, options.minutes * 60, options.cooldown * 60

    def save() -> None:
        state.save(saved)
        write_weights()

    while (elapsed := time.monotonic() - begin) < seconds:
        left = min(1.0, (seconds - elapsed) / cooldown) if cooldown else 1.0
        rate = config.learning_rate * min(1.0, (state.step + 1) / config.warmup_steps) * left
        found = []
        for _ in range(config.scenes_per_step):
            sample = next(scenes).to(device)
            with torch.autocast(device.type, torch.bfloat16):
                found.append(losses_of(sample))
            (found[-1]["total"] / config.scenes_per_step).backward()
        if state.advance(rate, config.clip_norm):
            for losses in found:
                log.add(losses)
            if state.step % LOG_EVERY == 0:
                log.write(state.step, skipped=state.skipped)
        else:
            print(f"step {state.step + 1}: skipped, its gradients are not finite", flush=True)
        if time.monotonic() - last_save > options.save_every:
            save()
            last_save = time.monotonic()
    if log.count:
        log.write(state.step, skipped=state.skipped)
    save()


def add_arguments(parser: argparse.ArgumentParser, config: str) -> None:
    """What every training takes; `config` is the file beside this one that holds the defaults."""
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name(config))
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--cooldown", type=float, default=0.0, help="minutes at the end with a falling learning rate")
    parser.add_argument("--save-every", type=float, default=180.0, help="seconds")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--seed", type=int, default=0)


def status(train: Callable[[argparse.Namespace, TrainConfig], None], options: argparse.Namespace) -> int:
    """Train with `add_arguments`, and return the exit status as `explained` does."""
    with team(options.threads):
        return explained(lambda: train(options, TrainConfig.load(options.config)))


def explained(work: Callable[[], None]) -> int:
    """The exit status of some work: 2, and one sentence on stderr, for what the user can put right."""
    try:
        work()
    except (TrainingError, CheckpointError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0
