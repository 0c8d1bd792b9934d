# SPDX-License-Identifier: GPL-3.0-or-later
"""Training that starts from the weights of another network: fine-tuning, and networks with more guides than before."""
from __future__ import annotations

from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import nn

from .errors import TrainingError


def start_from(model: nn.Module, folder: Path) -> None:
    """Take over the weights in folder/model.safetensors; inputs that only `model` has start at zero.

    Raises TrainingError when a tensor is missing there, or has another shape than fewer inputs explain.
    """
    stored = load_file(folder / "model.safetensors")
    with torch.no_grad():
        for name, p in model.named_parameters():
            if name not in stored:
                raise TrainingError(f"{folder} has no {name}: it holds another network")
            found = stored[name].to(p)
            if found.shape != p.shape and not _has_fewer_inputs(found, p):
                raise TrainingError(f"{folder}: {name} has shape {tuple(found.shape)}, not {tuple(p.shape)}")
            if found.shape == p.shape:
                p.copy_(found)
            else:
                p.zero_()
                p[:, :found.shape[1]] = found


def _has_fewer_inputs(found: torch.Tensor, p: torch.Tensor) -> bool:
    return (found.ndim == p.ndim > 1 and found.shape[1] < p.shape[1]
            and (found.shape[0], *found.shape[2:]) == (p.shape[0], *p.shape[2:]))
