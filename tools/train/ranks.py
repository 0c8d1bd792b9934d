# SPDX-License-Identifier: GPL-3.0-or-later
"""The processes that train one network together, as torchrun starts them; without torchrun there is one.

Each has an equal share of the scenes of a step. All hold the same weights: DistributedDataParallel takes the mean of
their gradients. The first one reads the clock and writes the files.
"""
from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from datetime import timedelta

import torch
import torch.distributed.nn  # noqa: F401  imported later it would keep our group, and its threads, beyond Python's end
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from .errors import TrainingError

PATIENCE = timedelta(hours=6)  # for one that waits for samples, prepares or saves them, while the others wait for it


@contextmanager
def join(options: argparse.Namespace):
    """Join the processes that torchrun started, inside; `options.device` "cuda" becomes its own card."""
    if "TORCHELASTIC_RUN_ID" not in os.environ:
        yield
        return
    if options.device == "cuda":
        card = int(os.environ["LOCAL_RANK"])
        options.device = f"cuda:{card}"
        torch.cuda.set_device(card)
    distributed.init_process_group("cpu:gloo,cuda:nccl" if "cuda" in options.device else "gloo", timeout=PATIENCE)
    try:
        yield
    finally:
        distributed.destroy_process_group()


def _has_group() -> bool:
    return distributed.is_available() and distributed.is_initialized()


def rank() -> int:
    return distributed.get_rank() if _has_group() else 0


def count() -> int:
    return distributed.get_world_size() if _has_group() else 1


def is_first() -> bool:
    """Whether this process is the one that writes and prints."""
    return rank() == 0


def share(number: int, what: str) -> int:
    """A process's share of so many. Raises TrainingError, beginning with `what`, when they cannot be shared equally."""
    if number % count():
        raise TrainingError(f"{what}: {number} cannot be shared equally by {count()} processes: choose a multiple")
    return number // count()


def broadcast(value: float) -> float:
    """The first process's value."""
    if not _has_group():
        return value
    values = torch.tensor([value], dtype=torch.float64)
    distributed.broadcast(values, 0)
    return float(values)


def compute_means(values: dict[str, torch.Tensor]) -> dict[str, float]:
    """The mean over all processes of each of these scalars."""
    totals = torch.stack([value.detach().double().cpu() for value in values.values()])
    if _has_group():
        distributed.all_reduce(totals)
    return dict(zip(values, (totals / count()).tolist(), strict=True))


def gather(own: dict) -> dict:
    """The entries of all processes, together."""
    if not _has_group():
        return own
    parts: list[dict] = [{}] * count()
    distributed.all_gather_object(parts, own)
    return {key: value for part in parts for key, value in part.items()}


def wait_for_all() -> None:
    """Until all processes are here."""
    compute_means({"": torch.zeros(())})


def one_after_another(work: Callable[[], None]) -> None:
    """The first process does it before the others do. What it raises ends them too, as torchrun sees to."""
    if is_first():
        work()
    wait_for_all()
    if not is_first():
        work()


class _Loss(nn.Module):
    """A loss as the forward pass of a module, around which DistributedDataParallel can be put."""

    def __init__(self, model: nn.Module, loss: Callable):
        super().__init__()
        self.model, self.loss = model, loss

    def forward(self, *inputs):
        return self.loss(*inputs)


def with_shared_gradients(model: nn.Module, loss: Callable) -> Callable:
    """loss(*inputs), whose gradients with respect to the model become the mean over all processes.

    Parameters that no process's inputs reach keep no gradient, as without other processes.
    """
    if not _has_group():
        return loss
    return DistributedDataParallel(_Loss(model, loss), find_unused_parameters=True, broadcast_buffers=False)


def accumulating(loss: Callable, *, last: bool):
    """Only add gradients up inside, unless these are the `last` ones of a step."""
    return nullcontext() if last or not _has_group() else loss.no_sync()
