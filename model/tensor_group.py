# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of tensors that move to a device, and are stacked, together."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import torch


class TensorGroup:
    """Base of dataclasses whose fields are tensors, other groups, or None."""

    def to(self, device, non_blocking: bool = False):
        """A copy on `device`. non_blocking: as for `Tensor.to`, from pinned memory to a card."""
        return self._mapped(lambda value: value.to(device, non_blocking=non_blocking))

    def pin_memory(self):
        """A copy in memory that a card can read by itself; PyTorch's DataLoader calls it."""
        return self._mapped(lambda value: value.pin_memory())

    def _mapped(self, change: Callable):
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return type(self)(**{name: v if v is None else change(v) for name, v in values.items()})


def stacked(groups: list):
    """Groups of one kind, all of whose fields are there, behind each other: several views as one input."""
    def joined(parts: list):
        return torch.cat(parts) if isinstance(parts[0], torch.Tensor) else stacked(parts)

    return type(groups[0])(**{f.name: joined([getattr(group, f.name) for group in groups]) for f in fields(groups[0])})
