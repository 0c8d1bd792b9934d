# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a training as one safetensors file: weights, their running average, the optimisers' moments, the step.

The file before the newest is kept beside it, and a run goes on from that one when the newest is damaged.
"""
from __future__ import annotations

from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from .errors import TrainingError
from .muon import Muon

# Of each parameter; one without gradients is not stepped.
MOMENTS = {torch.optim.AdamW: ("step", "exp_avg", "exp_avg_sq"), Muon: ("momentum_buffer",)}
MOST_SKIPPED = 20                             # steps in a row
DAMAGED = (SafetensorError, OSError, ValueError, KeyError, TypeError)  # what unreadable files raise


class TrainingState:
    """muon: how the names of the layers begin whose matrices Muon updates, `muon_rate` times as fast as AdamW all else.
    """

    def __init__(self, model: nn.Module, learning_rate: float, weight_decay: float, average_decay: float,
                 muon: tuple[str, ...] = (), muon_rate: float = 1.0):
        self.model, self.step, self.decay = model, 0, average_decay
        self.skipped = self._skipped_in_a_row = 0
        trained = {name: p for name, p in model.named_parameters() if p.requires_grad}
        hidden = {name: p for name, p in trained.items() if p.ndim == 2 and name.startswith(tuple(muon))}
        others = [p for name, p in trained.items() if name not in hidden]
        matrices, vectors = [p for p in others if p.ndim > 1], [p for p in others if p.ndim <= 1]
        self.optimizers = [torch.optim.AdamW(
            [{"params": matrices, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}],
            lr=learning_rate, betas=(0.9, 0.98), fused=True)]
        if hidden:
            groups = [{"params": [*hidden.values()], "rate": muon_rate}]
            self.optimizers.append(Muon(groups, learning_rate, weight_decay))
        self.optimizer_of = {p: optimizer for optimizer in self.optimizers for group in optimizer.param_groups
                             for p in group["params"]}
        self.average = {name: p.detach().clone() for name, p in model.named_parameters()}

    def advance(self, learning_rate: float, clip_norm: float) -> bool:
        """One optimiser step with the gradients that are there, which are then cleared.

        Nothing but the count `skipped` changes, and False comes back, if their norm is not finite. Raises TrainingError
        after MOST_SKIPPED such steps in a row.
        """
        norm = nn.utils.clip_grad_norm_(self.model.parameters(), clip_norm)
        if norm.isfinite():
            for optimizer in self.optimizers:
                for group in optimizer.param_groups:
                    group["lr"] = group.get("rate", 1.0) * learning_rate
                optimizer.step()
            self.step += 1
            self._update_average()
            self._skipped_in_a_row = 0
        else:
            self.skipped += 1
            self._skipped_in_a_row += 1
        self.model.zero_grad(set_to_none=True)
        if self._skipped_in_a_row >= MOST_SKIPPED:
            raise TrainingError(f"the gradients of {MOST_SKIPPED} steps in a row, after step {self.step}, are not "
                                "finite: lower learning_rate or clip_norm, or look for broken samples")
        return bool(norm.isfinite())

    def _update_average(self) -> None:
        """Exponential running average with a shorter memory at the start."""
        decay = min(self.decay, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.average.values()), list(self.model.parameters()), 1 - decay)

    def save(self, path: Path) -> None:
        """Replace `path`, which becomes `backup(path)`. Raises TrainingError if a value is not finite."""
        tensors = {}
        for name, p in self.model.named_parameters():
            tensors[f"model.{name}"], tensors[f"average.{name}"] = p.detach(), self.average[name]
            tensors |= {f"{value}.{name}": moment for value, moment in self._moments(p).items()}
        if wrong := _not_finite(tensors):
            raise TrainingError(f"{wrong} is no longer finite at step {self.step}, which is not saved: "
                                "lower learning_rate and run again to go on from the last save")
        temporary = path.with_suffix(".tmp")
        save_file({k: v.cpu().contiguous() for k, v in tensors.items()}, temporary, metadata={"step": str(self.step)})
        if path.is_file():
            path.replace(backup(path))
        temporary.replace(path)

    def resume(self, path: Path) -> bool:
        """Continue from `save`, or from its backup where it is missing or damaged; False if there is neither.

        A damaged file is set aside as *.damaged. Raises TrainingError when all are damaged or of another network.
        """
        files = [file for file in (path, backup(path)) if file.is_file()]
        for file in files:
            try:
                step, tensors = _read(file)
            except DAMAGED as error:
                print(f"{file} is damaged ({error})", flush=True)
                continue
            if file != path and path.is_file():  # the next save would make it the backup
                path.replace(path.with_name(path.name + ".damaged"))
            self._take(file, step, tensors)
            return True
        if files:
            raise TrainingError(f"{' and '.join(map(str, files))} cannot be read: "
                                "restore one of them, or delete them to start again")
        return False

    def _moments(self, p: nn.Parameter) -> dict[str, Tensor]:
        return self.optimizer_of[p].state.get(p, {}) if p in self.optimizer_of else {}

    def _take(self, path: Path, step: int, tensors: dict[str, Tensor]) -> None:
        stored = {name: tensor.shape for name, tensor in tensors.items() if name.startswith(("model.", "average."))}
        if stored != {f"{kind}.{name}": p.shape for kind in ("model", "average")
                      for name, p in self.model.named_parameters()}:
            raise TrainingError(f"{path} is of another network than the one to be trained: "
                                "choose its preset, or another folder")
        self.step = step
        with torch.no_grad():
            for name, p in self.model.named_parameters():
                p.copy_(tensors[f"model.{name}"])
                self.average[name].copy_(tensors[f"average.{name}"])
                if optimizer := self.optimizer_of.get(p):  # the file may be of a run in which another one stepped it
                    names = {value: f"{value}.{name}" for value in MOMENTS[type(optimizer)]}
                    if all(key in tensors for key in names.values()):
                        optimizer.state[p] = {value: tensors[key].to(p.device) for value, key in names.items()}


def backup(path: Path) -> Path:
    """state.safetensors -> state.previous.safetensors"""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def _read(path: Path) -> tuple[int, dict[str, Tensor]]:
    """Step and tensors of a file, complete and finite, or one of DAMAGED."""
    with safe_open(path, "pt") as file:
        step = int(file.metadata()["step"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    for name in [name for name in tensors if name.startswith("exp_avg.")]:  # older files have one step for all
        tensors.setdefault(name.replace("exp_avg.", "step.", 1), torch.tensor(float(step)))
    if wrong := _not_finite(tensors):
        raise ValueError(f"{wrong} is not finite")
    return step, tensors


def _not_finite(tensors: dict[str, Tensor]) -> str | None:
    return next((name for name, tensor in tensors.items() if not tensor.isfinite().all()), None)
