# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheels that may be installed on this computer: pinned versions, hashes and sizes (tools/pin_packages.py).

On Linux and Windows there are two builds of PyTorch. The package index has the one for CUDA for Linux, and the one for
the CPU for Windows; PyTorch's own index has the other.
Also used in package_worker.py: standard library only.
"""
from __future__ import annotations

import json
import os
import platform
import shutil
import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

PINS = Path(__file__).with_name("wheels.json")
BUILDS = ("CUDA", "CPU")
CPU_TORCH, CUDA_TORCH = "torch+cpu", "torch+cuda"  # in PINS; elsewhere their name is torch, as that of the others
CUDA = "cu132"  # the release of CUDA that PyTorch's own index has the pinned version for


class NoWheel(Exception):
    """A package is not made for this computer; the message says which."""


@dataclass(frozen=True)
class Wheel:
    name: str                # normalised, as distributions.normalise does
    version: str
    sha256: tuple[str, ...]  # of all files that fit, or empty when unknown: on PyTorch's own index
    download: int            # bytes
    unpacked: int            # bytes, an estimate on systems where it was not measured
    index: str = ""          # address of the package index, "" for pip's own


@cache
def pins() -> dict:
    """{"needs": {distribution: [distributions]}, "wheels": {distribution: {"version", "files": {tag: ...}}}}."""
    return json.loads(PINS.read_text())


def torch_distribution(build: str) -> str:
    """The name in PINS of a build of PyTorch on this system."""
    if sys.platform == "linux" and build == "CPU":
        return CPU_TORCH
    return CUDA_TORCH if sys.platform == "win32" and build == "CUDA" and _wheel(CUDA_TORCH) else "torch"


def has_builds() -> bool:
    """Whether this system has two builds of PyTorch to choose from."""
    return torch_distribution("CPU") != torch_distribution("CUDA")


def parse_cuda_release(address: str) -> str:
    """The release of CUDA that a package index of PyTorch's is for, the end of its address: "cu132"."""
    return address.rstrip("/").rpartition("/")[2]


def public_version(version: str) -> str:
    """A version without its build: "2.15.0" of "2.15.0+cpu"."""
    return version.partition("+")[0]


def find_wheels(distribution: str, build: str = "CUDA", cuda: str = CUDA) -> list[Wheel]:
    """The distribution and all that it needs, but numpy; cuda: the release for Windows ("cu132"). Raises NoWheel."""
    if distribution == "torch":
        distribution = torch_distribution(build)
    if not is_made(distribution):
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        version, name = pins()["wheels"][distribution]["version"], distribution.partition("+")[0]
        raise NoWheel(f"{name} {version} is not made for Python {python} on {platform.system()} {platform.machine()}: "
                      f"use a Blender from blender.org, which brings a Python that it is made for, or install {name} "
                      "into this Python yourself")
    wheels = filter(None, map(_wheel, pins()["needs"][distribution]))
    return [replace(wheel, version=f"{wheel.version}+{cuda}") if distribution == CUDA_TORCH and wheel.name == "torch"
            else wheel for wheel in wheels]


def is_made(distribution: str) -> bool:
    """Whether there is a wheel of a pinned distribution for this computer."""
    return _wheel(distribution) is not None


def _wheel(name: str) -> Wheel | None:
    pin = pins()["wheels"][name]
    files = [file for tag, file in pin["files"].items() if fits(tag)]
    if not files:
        return None  # needed on other systems
    hashes = tuple(file["sha256"] for file in files if file["sha256"])
    return Wheel(name.partition("+")[0], pin["version"], hashes, files[0]["download"], files[0]["unpacked"])


def fits(tag: str) -> bool:
    """Whether a wheel with this tag is for this Python and system. pip would know, but does not list sizes."""
    python, abi, system = tag.split("-")
    if not (python == abi == f"cp3{sys.version_info.minor}" or abi == "none"
            or abi == "abi3" and int(python.removeprefix("cp3")) <= sys.version_info.minor):
        return False
    machine = {"amd64": "x86_64"}.get(platform.machine().lower(), platform.machine().lower())
    if system == "any":
        return True
    if sys.platform == "win32":
        return system == {"x86_64": "win_amd64"}.get(machine, f"win_{machine}")
    if sys.platform == "darwin":
        return system.startswith("macosx") and system.endswith((machine, "universal2"))
    return system.startswith("manylinux") and system.endswith(machine)


def space_needed(wheels: list[Wheel]) -> int:
    """Bytes of free disk needed to install these: one at a time is there both packed and unpacked."""
    return sum(wheel.unpacked for wheel in wheels) + max((wheel.download for wheel in wheels), default=0)


def has_nvidia_driver() -> bool:
    library = Path(os.environ.get("SystemRoot", r"C:\Windows"), "System32", "nvml.dll")
    return (Path("/proc/driver/nvidia").exists() or shutil.which("nvidia-smi") is not None
            or sys.platform == "win32" and library.exists())


def choose_build(choice: str) -> str:
    """The build of PyTorch that AUTO, CUDA or CPU means here; only Linux and Windows have both."""
    if choice == "AUTO":
        return "CUDA" if not has_builds() or has_nvidia_driver() else "CPU"
    return choice


def requirement(distribution: str) -> str:
    """"torch==2.15.0", for a user's own pip."""
    pin = pins()["wheels"].get(distribution)
    return f"{distribution}=={pin['version']}" if pin else distribution
