# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the chosen device is there: PyTorch says it before a render, panels guess it without importing PyTorch."""
from __future__ import annotations

import sys

from ...model.errors import CheckpointError
from ..setup import importing, packages, wheels

ALWAYS_THERE = ("auto", "cpu")

_answers: dict[str, str] = {}  # what PyTorch said last, by device


def require(device: str) -> None:
    """Raises CheckpointError, with what to do, for a device that PyTorch cannot use."""
    if device in ALWAYS_THERE:
        return  # without the two seconds that the first import takes
    importing.import_packages()
    from ...model.compute.devices import choose_device
    try:
        choose_device(device, wheels.has_nvidia_driver())
    except ValueError as error:
        _answers[device] = str(error)
        raise CheckpointError(str(error)) from error
    _answers[device] = ""


def find_problem(device: str) -> str:
    """Why a render will refuse the device, as far as is known; or ""."""
    if device in ALWAYS_THERE:
        return ""
    return _answers[device] if device in _answers else _guess(device.partition(":")[0])


def _guess(kind: str) -> str:
    if kind == "mps":
        return "" if sys.platform == "darwin" else "Metal is Apple's: set Device to Automatic or CPU"
    build = packages.installed_build()
    if build == "CPU":
        return ("The installed PyTorch is a build for the CPU, without CUDA: choose the CUDA build in Preferences > "
                "Add-ons > RenderFormer-V2, or set Device to Automatic or CPU")
    if build.startswith("CUDA") and not wheels.has_nvidia_driver():
        return "No NVIDIA driver was found: install it, or set Device to Automatic or CPU"
    return ""
