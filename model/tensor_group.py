# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of tensors that move to a device, and are stacked, together."""
from __future__ import annotations

from dataclasses import fields

import torch


class TensorGroup:
    """Base of dataclasses whose fields are tensors, other groups, or None."""

    def to(self, device):
        """A copy on `device`."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return type(self)(**{name: v if v is None else v.to(device) for name, v in values.items()})


def stacked(groups: list):
    """Groups of one kind, all of whose fields are there, behind each other: several views as one input."""
    def joined(parts: list):
        return torch.cat(parts) if isinstance(parts[0], torch.Tensor) else stacked(parts)

    return type(groups[0])(**{f.name: joined([getattr(group, f.name) for group in groups]) for f in fields(groups[0])})
