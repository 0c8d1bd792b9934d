# SPDX-License-Identifier: GPL-3.0-or-later
"""What training must remember, as one safetensors file: weights, their running average, AdamW's moments, the step."""
from __future__ import annotations

from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import nn

MOMENTS = ("exp_avg", "exp_avg_sq")


class TrainingState:
    def __init__(self, model: nn.Module, learning_rate: float, weight_decay: float, average_decay: float):
        self.model, self.step, self.decay = model, 0, average_decay
        matrices = [p for p in model.parameters() if p.requires_grad and p.ndim > 1]
        vectors = [p for p in model.parameters() if p.requires_grad and p.ndim <= 1]
        self.optimizer = torch.optim.AdamW(
            [{"params": matrices, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}],
            lr=learning_rate, betas=(0.9, 0.98), fused=True)
        self.average = {name: p.detach().clone() for name, p in model.named_parameters()}

    def advance(self, learning_rate: float) -> None:
        """One optimiser step with the gradients that are there, which are then cleared."""
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        self.step += 1
        self._update_average()

    def _update_average(self) -> None:
        """Exponential running average with a shorter memory at the start."""
        decay = min(self.decay, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for name, p in self.model.named_parameters():
                self.average[name].lerp_(p.to(self.average[name].dtype), 1 - decay)

    def save(self, path: Path) -> None:
        tensors = {}
        for name, p in self.model.named_parameters():
            tensors[f"model.{name}"], tensors[f"average.{name}"] = p.detach(), self.average[name]
            for moment in MOMENTS:
                if p in self.optimizer.state:
                    tensors[f"{moment}.{name}"] = self.optimizer.state[p][moment]
        temporary = path.with_suffix(".tmp")
        save_file({k: v.cpu().contiguous() for k, v in tensors.items()}, temporary, metadata={"step": str(self.step)})
        temporary.replace(path)

    def load(self, path: Path) -> None:
        """Continue from `save`; shapes must be those of this model."""
        tensors = load_file(path)
        with safe_open(path, "pt") as file:
            self.step = int(file.metadata()["step"])
        with torch.no_grad():
            for name, p in self.model.named_parameters():
                p.copy_(tensors[f"model.{name}"])
                self.average[name].copy_(tensors[f"average.{name}"])
                if f"exp_avg.{name}" in tensors:
                    self.optimizer.state[p] = {"step": torch.tensor(float(self.step), device=p.device)} | {
                        moment: tensors[f"{moment}.{name}"].to(p.device) for moment in MOMENTS}
