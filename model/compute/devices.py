# SPDX-License-Identifier: GPL-3.0-or-later
"""The devices that PyTorch can compute on: which one to take, what it is called, why a card is not used, and which
operators run on the CPU because a device lacks them or gets them wrong.
"""
from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

import torch
from torch import Tensor

BUILT_FOR = re.compile(r"(sm|compute)_(\d+)(\d)[af]?$")


def choose_device(name: str = "auto", has_driver: bool = False) -> torch.device:
    """`auto` prefers CUDA, then Apple's MPS, then the CPU; of several cards that with the most memory. "cuda:1" is one
    by its number. has_driver: as in explain_unused_card. Raises ValueError for a device that is not there or that this
    PyTorch cannot use.
    """
    if name == "cpu":
        return torch.device("cpu")
    kind, _, number = name.partition(":")
    if kind in ("auto", "cuda") and torch.cuda.is_available():
        cards = range(torch.cuda.device_count())
        if number and int(number) not in cards:
            raise ValueError(f"there is no GPU {int(number) + 1}, only {len(cards)}: choose another GPU, or 0")
        if fitting := [i for i in ([int(number)] if number else cards) if not explain_too_old(i)]:
            return torch.device("cuda", max(fitting, key=lambda i: torch.cuda.get_device_properties(i).total_memory))
    if kind == "cuda":
        if reason := explain_unused_card(has_driver):
            raise ValueError(f"{reason}, or set Device to Automatic or CPU")
        raise ValueError("Device is CUDA, but PyTorch finds no GPU for it: set Device to Automatic or CPU")
    if kind == "mps" and not torch.backends.mps.is_available():
        raise ValueError("Device is Metal, but PyTorch finds no GPU for it: set Device to Automatic or CPU")
    return torch.device("mps" if torch.backends.mps.is_available() else "cpu")


def explain_unused_card(has_driver: bool = False) -> str:
    """Why `auto` would not use an NVIDIA card, and what to do; "" where it would, or there is none.

    has_driver: whether the system has a driver of NVIDIA's, for a PyTorch that cannot say so.
    """
    if torch.version.cuda is None:
        if not has_driver or torch.version.hip:
            return ""
        return ("the NVIDIA card is not used, because this PyTorch is a build for the CPU: choose the CUDA build in "
                "Preferences > Add-ons > RenderFormer-V2")
    if torch.cuda.is_available():
        reasons = [explain_too_old(i) for i in range(torch.cuda.device_count())]
        return reasons[0] if all(reasons) else ""
    supported, needed = driver_version(), tuple(map(int, torch.version.cuda.split(".")))
    if supported and supported[0] < needed[0]:
        return (f"the NVIDIA card is not used, because its driver is too old: it knows CUDA "
                f"{supported[0]}.{supported[1]}, and this PyTorch needs {needed[0]}.0. Update the driver")
    return ("the NVIDIA card is not used, because PyTorch finds none although there is a driver: start Blender again, "
            "or update the driver") if supported or has_driver else ""


def driver_version() -> tuple[int, int] | None:
    """The newest CUDA that the driver supports; None without a driver."""
    version = torch._C._cuda_getDriverVersion() if hasattr(torch._C, "_cuda_getDriverVersion") else 0
    return (version // 1000, version % 1000 // 10) if version > 0 else None


def explain_too_old(card: int) -> str:
    """Why a card has no programs in this build of PyTorch, and what to do; or ""."""
    capability, builds = torch.cuda.get_device_capability(card), torch.cuda.get_arch_list()
    if is_built_for(capability, builds):
        return ""
    return (f"{torch.cuda.get_device_name(card)} (compute capability {capability[0]}.{capability[1]}) is not used, "
            f"because this PyTorch for CUDA {torch.version.cuda} has no programs for it: install a build of PyTorch "
            "that has, for cards before Turing one for CUDA 12.6")


def is_built_for(capability: tuple[int, int], builds: list[str]) -> bool:
    """builds: as of torch.cuda.get_arch_list(). Programs run on later cards of the same major number, and compute_* are
    translated for all that are later. Names that are not NVIDIA's are AMD's, whose drivers tell by themselves."""
    matches = [BUILT_FOR.match(build) for build in builds]
    if not all(matches) or not matches:
        return True
    for kind, *number in (match.groups() for match in matches):
        built = tuple(map(int, number))
        if built <= capability and (kind == "compute" or built[0] == capability[0]):
            return True
    return False


@cache
def device_name(device: torch.device) -> str:
    """"NVIDIA GeForce RTX 4090 (CUDA)", "Apple GPU (Metal)", or "CPU (AMD EPYC)"."""
    if device.type == "cuda":
        index = device.index or 0
        several = f" {index + 1}" if torch.cuda.device_count() > 1 else ""
        return f"{torch.cuda.get_device_name(device)} ({'ROCm' if torch.version.hip else 'CUDA'}{several})"
    if device.type == "mps":
        return "Apple GPU (Metal)"
    cpu = str(torch.cpu.get_capabilities().get("cpu_name", "")).strip() if hasattr(
        torch.cpu, "get_capabilities") else ""
    return f"CPU ({cpu})" if cpu else "CPU"


def free_memory(device: torch.device, with_ours: bool = False) -> int | None:
    """Free bytes of a card, including those that PyTorch has reserved; None for other devices.

    with_ours: count those that tensors of this process occupy as free.
    """
    if device.type != "cuda":
        return None
    free, _ = torch.cuda.mem_get_info(device)
    return free + torch.cuda.memory_reserved(device) - (0 if with_ours else torch.cuda.memory_allocated(device))


# By PyTorch's name of an operator, the release from which on the GPU can do it.
SINCE = {
    "_embedding_bag": None,      # of F.embedding_bag
    "grid_sampler_3d": (2, 13),  # of F.grid_sample; with the padding "border", which came after the operator
    "sort": None,                # of int64, which comes out wrong on some systems, without a word
}


def device_of_operator(device: torch.device, name: str, release=torch.__version__) -> torch.device:
    """Where the operator of this name runs for tensors of a device; `release` is PyTorch's, (major, minor)."""
    lacking = name in SINCE and (SINCE[name] is None or release < SINCE[name])
    return torch.device("cpu") if device.type == "mps" and lacking else device


def run_operator(name: str, function: Callable[..., Tensor], *tensors: Tensor, **options) -> Tensor:
    """function(*tensors, **options), which calls the operator of this name, on the tensors' device."""
    device = tensors[0].device
    return function(*(x.to(device_of_operator(device, name)) for x in tensors), **options).to(device)
