# SPDX-License-Identifier: GPL-3.0-or-later
"""What a graphics card would be waited for, or cannot do: refused on the CPU, so that no card is needed to find it."""
from __future__ import annotations

import torch
from torch.utils._python_dispatch import TorchDispatchMode

ASKING = ("_local_scalar_dense", "nonzero", "masked_select", "_unique2", "unique_dim", "is_nonzero", "equal")
REFUSED = (torch.float64, torch.complex128)


class NoHostCopies(TorchDispatchMode):
    """Refuses operators whose result the host has to know before it goes on, and float64. Tensors made on the host are
    copied to a card without waiting, and are let through."""

    def __init__(self):
        super().__init__()
        self.attentions = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.overloadpacket.__name__
        indices = args[1] if name in ("index", "index_put", "index_put_") else ()
        if name in ASKING or any(i is not None and i.dtype in (torch.bool, torch.uint8) for i in indices):
            raise AssertionError(f"{func} makes the host wait for the card")
        self.attentions += "scaled_dot_product" in name
        result = func(*args, **(kwargs or {}))
        for x in result if isinstance(result, (tuple, list)) else [result]:
            if isinstance(x, torch.Tensor) and x.dtype in REFUSED:
                raise AssertionError(f"{func} computes in {x.dtype}, for which cards are slow or unable")
        return result
