# SPDX-License-Identifier: GPL-3.0-or-later
"""Apple's GPU, pretended: tensors that say they are on it and are refused what it refuses, computed on the CPU.

It has no float64, it takes no tensors of the CPU beside its own, and it lacks some of PyTorch's operators, of which the
installed PyTorch's own table tells.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

from tests.model.mps_operators import is_composite, is_supported

MPS, CPU = torch.device("mps"), torch.device("cpu")
REFUSED = (torch.float64, torch.complex128)
CROSSING = ("copy_", "_to_copy", "to")         # take tensors of two devices
INDEXING = (torch.Tensor.__getitem__, torch.Tensor.__setitem__)
INDEXED = ("index", "index_put", "index_put_")  # take indices of the CPU
WRONG = ("sort", "argsort", "_unique2", "unique_dim")  # of int64, on some systems and without a word
# Asked for what it is made of, PyTorch looks for kernels of a device that is not there.
WHOLE = ("scaled_dot_product_attention", "to")
# Python's methods ask for the device itself, the operators do not.
DIRECT = {
    torch.Tensor.__invert__: torch.ops.aten.bitwise_not, torch.Tensor.nonzero: torch.ops.aten.nonzero,
    torch.Tensor.contiguous: torch.ops.aten.clone, torch.Tensor.copy_: torch.ops.aten.copy_,
    torch.Tensor.__float__: lambda x: float(x.item()), torch.Tensor.__int__: lambda x: int(x.item()),
    torch.Tensor.tolist: lambda x: x.cpu().tolist(),
}
MADE = (torch.tensor, torch.as_tensor, torch.Tensor.new_tensor)  # from Python's numbers


@contextmanager
def pretended_mps():
    """Inside, `torch.device("mps")` holds tensors and modules, on this thread.

    What the real one refuses is refused with TypeError (float64), RuntimeError (two devices) and NotImplementedError
    (an operator that it lacks).
    """
    before = torch.__future__.get_overwrite_module_params_on_conversion()
    torch.__future__.set_overwrite_module_params_on_conversion(True)
    try:
        with _Functions(), _Operators():
            yield MPS
    finally:
        torch.__future__.set_overwrite_module_params_on_conversion(before)


class Pretended(torch.Tensor):
    """A tensor on the device, of which `held` is the content."""

    @staticmethod
    def __new__(cls, held: torch.Tensor):
        if held.dtype in REFUSED:
            raise TypeError(f"there is no {held.dtype} on MPS")
        return torch.Tensor._make_wrapper_subclass(cls, held.size(), strides=held.stride(), dtype=held.dtype,
                                                   storage_offset=held.storage_offset(), device=MPS)

    def __init__(self, held: torch.Tensor):
        self.held = held

    def __repr__(self, **_):
        return f"Pretended({self.held})"

    @classmethod
    def __torch_dispatch__(cls, func, types, args=(), kwargs=None):
        raise RuntimeError(f"{func} was called for MPS on another thread than where it is pretended")

    __torch_function__ = torch._C._disabled_torch_function_impl


class _Functions(TorchFunctionMode):
    """What PyTorch does before it dispatches, and not without a real device."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        if func is torch.Tensor.to:
            return _moved(args[0], *torch._C._nn._parse_to(*args[1:], **kwargs)[:2])
        func = DIRECT.get(func, func)
        if func in INDEXING and any(isinstance(x, Pretended) for x in _tensors(args)):
            if not isinstance(args[0], Pretended):
                raise RuntimeError("a tensor on the CPU was indexed with one on MPS")
            result = func(*_held(args))
            return result if result is None else Pretended(result)
        device = kwargs.get("device") or (getattr(args[0], "device", None) if func is torch.Tensor.new_tensor else None)
        if func in MADE and device is not None and torch.device(device).type == "mps":
            if isinstance(args[0], Pretended) and func is torch.Tensor.new_tensor:
                args = (args[0].held, *args[1:])
            return func(*args, **kwargs | {"device": CPU}).to(MPS)
        return func(*args, **kwargs)


class _Operators(TorchDispatchMode):
    """Every operator that is called."""

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        return False  # for that PyTorch would import its compiler, which takes seconds

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs, name = kwargs or {}, func.overloadpacket.__name__
        device = kwargs.get("device")
        arrives = device is not None and torch.device(device).type == "mps"
        leaves = device is not None and not arrives
        given = list(_tensors((args, kwargs)))
        here = [x for x in given if isinstance(x, Pretended)]
        if not here and not arrives:
            return func(*args, **kwargs)
        if name not in WHOLE and is_composite(func.name()):
            with self:
                return func.decompose(*args, **kwargs)
        if name not in CROSSING:
            _require_one_device(name, given)
        if not is_supported(func.name()):
            raise NotImplementedError(f"{func.name()} is not implemented on MPS")
        if name in WRONG and given[0].dtype == torch.int64:
            raise NotImplementedError(f"{func.name()} is wrong of int64 on MPS")
        args, kwargs = _held((args, kwargs | {"device": CPU} if arrives else kwargs))
        result = func(*args, **kwargs)
        if leaves or name == "copy_" and not isinstance(given[0], Pretended):
            return result
        known = {id(x.held): x for x in here}
        return _mapped(result, torch.Tensor, lambda x: known[id(x)] if id(x) in known else Pretended(x))


def _moved(x: torch.Tensor, device: torch.device | None, dtype: torch.dtype | None) -> torch.Tensor:
    """x.to(device, dtype), either of which may be left out."""
    held, here = _held(x), isinstance(x, Pretended)
    stays = device is None or (device.type == "mps") == here
    done = held.to(dtype or held.dtype, copy=not stays)
    arrived = here if stays else not here
    return x if done is held else Pretended(done.detach()) if arrived else done


def _held(tree):
    return _mapped(tree, Pretended, lambda x: x.held)


def _mapped(tree, kind: type, function: Callable):
    """Arguments or results with the function's result in place of everything of a kind."""
    if isinstance(tree, kind):
        return function(tree)
    if isinstance(tree, tuple | list):
        return type(tree)(_mapped(x, kind, function) for x in tree)
    return {key: _mapped(x, kind, function) for key, x in tree.items()} if isinstance(tree, dict) else tree


def _tensors(tree) -> Iterator[torch.Tensor]:
    if isinstance(tree, torch.Tensor):
        yield tree
    elif isinstance(tree, tuple | list | dict):
        for x in tree.values() if isinstance(tree, dict) else tree:
            yield from _tensors(x)


def _require_one_device(name: str, tensors: list[torch.Tensor]) -> None:
    tensors = tensors[:1] if name in INDEXED else tensors
    if not all(isinstance(x, Pretended) or not x.dim() for x in tensors):
        raise RuntimeError(f"{name} was given tensors on MPS and on the CPU")
