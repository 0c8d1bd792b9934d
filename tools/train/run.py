# SPDX-License-Identifier: GPL-3.0-or-later
"""The training loop: steps for some minutes or up to a number, with a log.

Its state is saved, so that another run goes on from there. As many processes take part as torchrun starts.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import torch
from torch import Tensor, nn

from renderformer_v2.model.compute.precision import choose_precision
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.network.layers import RMSNorm, SwiGLU
from tools.common.console import whole_number

from . import ranks
from .config import TrainConfig
from .errors import TrainingError
from .memory import recompute
from .state import TrainingState

COMPILED = SwiGLU, RMSNorm  # chains of small operations between the products and attentions, which gain by it
PRECISIONS = "auto", "bf16", "fp32"


def run(state: TrainingState, config: TrainConfig, options: argparse.Namespace, scenes: Iterator,
        compute_losses: Callable[..., dict[str, Tensor]], write_weights: Callable[[], None], batch: int = 1) -> None:
    """Go on from what `options.out` holds, for `options.minutes` or until `options.steps` are done in all.

    scenes: endless samples of this process, the first drawn after the state is restored. compute_losses(sample): losses
    on the sample's device, the one to minimise under "total". write_weights: saves the running average for rendering.
    batch: scenes in one of the samples.
    Raises TrainingError when training has gone wrong, or when a step is no whole number of batches.
    """
    device, saved = torch.device(options.device), options.out / "state.safetensors"
    samples_per_step = _count_samples(options.scenes_per_step or config.scenes_per_step, batch)
    options.out.mkdir(parents=True, exist_ok=True)
    resume(state, saved)
    if options.compile:
        compile_parts(state.model)
    recompute(state.model, config.recomputed)
    compute_losses = ranks.with_shared_gradients(state.model, compute_losses)
    precision = training_precision(options.precision, device)
    if ranks.is_first():
        size = sum(p.numel() for p in state.model.parameters())
        print(f"{ranks.count()} process(es), {size:,} parameters, step {state.step}", flush=True)
    log, begin = Log(options.out / "log.jsonl"), time.monotonic()
    last_save = begin

    def save() -> None:
        if ranks.is_first():
            state.save(saved)
            write_weights()

    while rate_share := ranks.broadcast(_remaining_share(options, state.step, time.monotonic() - begin)):
        samples = (next(scenes).to(device, non_blocking=True) for _ in range(samples_per_step))
        losses = _accumulate_gradients(samples, samples_per_step, compute_losses, device, precision)
        if state.advance(config.rate(state.step) * rate_share, config.clip_norm):
            log.add(losses)
            if state.step % options.log_every == 0:
                log.write(state.step, skipped=state.skipped)
        elif ranks.is_first():
            print(f"step {state.step + 1}: skipped, its gradients are not finite", flush=True)
        if time.monotonic() - last_save > options.save_every:
            save()
            last_save = time.monotonic()
    if log.count:
        log.write(state.step, skipped=state.skipped)
    save()


def _count_samples(scenes_per_step: int, batch: int) -> int:
    """The number of samples, each of `batch` scenes, that this process draws for a step."""
    scenes = ranks.share(scenes_per_step, "--scenes-per-step")
    if scenes % batch:
        raise TrainingError(f"a step of {scenes} scenes is no whole number of batches of {batch}: change --batch or "
                            "--scenes-per-step")
    return scenes // batch


def _accumulate_gradients(samples: Iterator, count: int, compute_losses: Callable[..., dict[str, Tensor]],
                          device: torch.device, precision: torch.dtype) -> dict[str, float]:
    """Propagate the mean loss of `count` samples back; returns the mean losses of all processes."""
    sample_losses = []
    for i, sample in enumerate(samples):
        with ranks.accumulating(compute_losses, last=i == count - 1):
            with torch.autocast(device.type, precision, enabled=precision != torch.float32):
                sample_losses.append(compute_losses(sample))
            (sample_losses[-1]["total"] / count).backward()
    return ranks.compute_means({
        name: sum(losses[name].detach() for losses in sample_losses) / count for name in sample_losses[0]})


def resume(state: TrainingState, saved: Path) -> None:
    """Every process reads the file; the first one comes first, because it sets damaged ones aside."""
    ranks.one_after_another(lambda: state.resume(saved))
    if state.step != ranks.broadcast(state.step):
        raise TrainingError(f"{saved} is not the same file for all processes: choose an --out that all machines share")


def _remaining_share(options: argparse.Namespace, step: int, elapsed: float) -> float:
    """Share of the learning rate after this step and time: 1, falling at the end, 0 when training is over."""
    if options.steps is not None and step >= options.steps:
        return 0.0
    if options.minutes is None:
        return 1.0
    remaining = 60 * options.minutes - elapsed
    if remaining <= 0:
        return 0.0
    return min(1.0, remaining / (60 * options.cooldown)) if options.cooldown else 1.0


def compile_parts(model: nn.Module) -> None:
    """torch.compile for COMPILED at first use, for any number of tokens; the names of the weights stay."""
    for module in model.modules():
        if isinstance(module, COMPILED):
            module.compile(dynamic=True)


def add_arguments(parser: argparse.ArgumentParser, config: str) -> None:
    """What every training takes; `config` is the file beside this one that holds the defaults."""
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name(config))
    length = parser.add_argument_group("how long, of which one is needed")
    length.add_argument("--minutes", type=float, help="of this run")
    length.add_argument("--steps", type=whole_number(1), help="of this and earlier runs in --out, all together")
    parser.add_argument("--cooldown", type=float, default=0.0,
                        help="of the --minutes, those at the end with a falling learning rate")
    parser.add_argument("--scenes-per-step", type=whole_number(1), metavar="N",
                        help="of all processes together (default: the configuration's)")
    add_precision(parser)
    parser.add_argument("--compile", action="store_true", help="let torch.compile join small operations, for cards")
    parser.add_argument("--workers", type=whole_number(1), default=1, help="that read samples, for each process")
    parser.add_argument("--log-every", type=whole_number(1), default=50, metavar="STEPS", help="default 50")
    parser.add_argument("--save-every", type=float, default=180.0, help="seconds")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--seed", type=int, default=0)


def add_precision(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--precision", choices=PRECISIONS, default="auto",
                        help="of the products (default: bf16 where the device multiplies it fast, else fp32)")


def training_precision(name: str, device: torch.device) -> torch.dtype:
    """One of PRECISIONS; never float16, in which gradients vanish."""
    precision = choose_precision(name, device)
    return torch.float32 if precision == torch.float16 else precision


def run_command(train: Callable[[argparse.Namespace, TrainConfig], None], options: argparse.Namespace) -> int:
    """Train with `add_arguments`, and return the exit status as `report_errors` does."""
    def work() -> None:
        if options.minutes is None and options.steps is None:
            raise TrainingError("--minutes or --steps: say for how long to train")
        train(options, TrainConfig.load(options.config))

    with team(options.threads), ranks.join(options):
        return report_errors(work)


def report_errors(work: Callable[[], None]) -> int:
    """The exit status of some work: 2, and one sentence on stderr, for what the user can put right."""
    try:
        work()
    except (TrainingError, CheckpointError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


class Log:
    def __init__(self, path: Path):
        self.path, self.begin = path, time.monotonic()
        self.sums: dict[str, float] = {}
        self.count = 0
        if ranks.is_first() and path.is_file() and not path.read_bytes().endswith(b"\n"):  # killed within a line
            self._append("\n")

    def add(self, losses: dict[str, float]) -> None:
        """Count the losses of one step into the means of the next line."""
        for name, value in losses.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.count += 1

    def write(self, step: int, **more) -> None:
        """A line with the means since the last one, also printed."""
        record = {"step": step, "minutes": round((time.monotonic() - self.begin) / 60, 2)}
        record |= {name: round(total / self.count, 7) for name, total in self.sums.items()} | more
        if ranks.is_first():
            self._append(json.dumps(record) + "\n")
            print(record, flush=True)
        self.sums, self.count = {}, 0

    def _append(self, text: str) -> None:
        with open(self.path, "a") as file:
            file.write(text)
