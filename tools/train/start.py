# SPDX-License-Identifier: GPL-3.0-or-later
"""Training that starts from the weights of another network: fine-tuning, and networks with more guides than before."""
from __future__ import annotations

from pathlib import Path

import torch
from safetensors.torch import load_file

from renderformer_v2.model.guided.network import GuidedRenderFormer

from .errors import TrainingError

KERNELS = "kernel_predictor."  # how their names begin


def start_from(model: GuidedRenderFormer, folder: Path) -> None:
    """Take over the weights in folder/model.safetensors; inputs and outputs that only `model` has start at zero.

    Without a kernel predictor there, `model` keeps its own; with nothing else there, its transformer starts by leaving
    light as it is. Raises TrainingError when a tensor is missing there for another reason, or has another shape than
    fewer inputs or outputs explain.
    """
    stored = load_file(folder / "model.safetensors")
    parts = {name.startswith(KERNELS) for name in stored}
    if parts == {True}:
        model.zero_outputs()
    with torch.no_grad():
        for name, p in model.named_parameters():
            if name.startswith(KERNELS) not in parts:
                continue
            if name not in stored:
                raise TrainingError(f"{folder} has no {name}: it holds another network")
            found = stored[name].to(p)
            if not _fits_into(found, p):
                raise TrainingError(f"{folder}: {name} has shape {tuple(found.shape)}, not {tuple(p.shape)}")
            p.zero_()
            p[tuple(slice(size) for size in found.shape[:2])] = found


def _fits_into(found: torch.Tensor, p: torch.Tensor) -> bool:
    """Whether nothing but either the outputs or the inputs, the first two axes, are fewer."""
    differ = [few < many for few, many in zip(found.shape[:2], p.shape) if few != many]
    return found.ndim == p.ndim and found.shape[2:] == p.shape[2:] and differ in ([], [True])
