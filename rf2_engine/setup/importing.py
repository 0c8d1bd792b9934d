# SPDX-License-Identifier: GPL-3.0-or-later
"""Import PyTorch. A process can try it only once, so the error of the first attempt stays."""
from __future__ import annotations

import importlib
import platform
import sys
import threading
import traceback
from importlib.util import find_spec

from . import extension, packages, wheels


class FirstAttempt:
    """The outcome of the first attempt to import. There is one: `_first_attempt`."""

    def __init__(self):
        self.lock, self.failure = threading.Lock(), ""


_first_attempt = FirstAttempt()


class BrokenPackages(packages.MissingPackages):
    """Packages exist but cannot be imported; the message says why and what to do."""


def failure() -> str:
    """The message of the first import that failed, or ""."""
    return _first_attempt.failure


def import_packages() -> None:
    """Import what the network needs. Raises BrokenPackages, in every attempt with the message of the first."""
    with _first_attempt.lock:
        for name in packages.NETWORK:
            if _first_attempt.failure:
                raise BrokenPackages(_first_attempt.failure)
            try:
                importlib.import_module(name)
            except MemoryError:
                raise
            except Exception as error:
                traceback.print_exc()
                _first_attempt.failure = _explain(name, error)
                raise BrokenPackages(_first_attempt.failure) from error


def _explain(name: str, error: Exception) -> str:
    lines = str(error).strip().splitlines() or [""]
    return (f"{name} cannot be loaded: {type(error).__name__}: {lines[0][:300]}. {_advice(name, str(error))}, "
            "then start Blender again")


def _advice(name: str, text: str) -> str:
    if sys.platform == "win32" and any(f"WinError {number}]" in text for number in (126, 127, 1114)):
        return "Install Microsoft's Visual C++ Redistributable (x64)"
    if packages.is_elsewhere(name):
        where = find_spec(name).origin if name not in sys.modules else "Blender's Python"
        advice = (f"It is the one in {where}: install it again with {sys.executable} -m pip install --force-reinstall "
                  f"{wheels.requirement(packages.PACKAGES[name])}")
    elif shared := extension.shared_folder(packages.PACKAGES_VARIABLE):
        advice = (f"The environment variable {packages.PACKAGES_VARIABLE} names {shared}: it has to be filled on a "
                  f"machine with the same system and Python {platform.python_version()}")
    else:
        advice = "Use Preferences > Add-ons > RenderFormer-V2 > Repair Packages"
    if any(word in text.lower() for word in ("libcu", "cuda", "nvidia", "nccl")):
        advice += ", update the NVIDIA driver, or choose PyTorch's CPU build in the preferences"
    return advice
