# SPDX-License-Identifier: GPL-3.0-or-later
"""Less memory for gradients: layers keep what goes into them, and compute the rest a second time for the gradients."""
from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from torch import nn
from torch.utils.checkpoint import checkpoint

from renderformer_v2.model.network.view_dependent import ViewDependentLayer
from renderformer_v2.model.network.view_independent import ViewIndependentLayer

from .errors import TrainingError

METHODS = {ViewIndependentLayer: ("forward",), ViewDependentLayer: ("forward", "keys_values")}


def recompute(model: nn.Module, parts: Iterable[str]) -> None:
    """Compute the transformer layers twice whose names begin with one of `parts`.

    Gradients and names of weights stay the same.
    Raises TrainingError for a part without such layers.
    """
    layers = {name: layer for name, layer in model.named_modules() if type(layer) in METHODS}
    for part in parts:
        if not any(name.startswith(part) for name in layers):
            raise TrainingError(f"recomputed: no transformer layer's name begins with {part!r}")
    for name, layer in layers.items():
        if name.startswith(tuple(parts)):
            for method in METHODS[type(layer)]:
                setattr(layer, method, partial(checkpoint, getattr(layer, method), use_reentrant=False))
