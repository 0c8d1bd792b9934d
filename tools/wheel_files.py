# SPDX-License-Identifier: GPL-3.0-or-later
"""The small wheels that an extension package brings along, by Blender's platform: pinned, downloaded by pip, hashed."""
from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

from .extension import ROOT

PINS = ROOT / "rf2_engine" / "setup" / "wheels.json"
SMALL = ("safetensors", "fast-simplification", "embreex")  # numpy is Blender's; PyTorch is too large to bring along
LICENSES = ("SPDX:Apache-2.0", "SPDX:BSD-2-Clause", "SPDX:MIT")  # theirs, and of the libraries in them
PYTHONS = ("cp311", "cp313")  # of Blender 4.5 to 5.0, and from 5.1 on
PLATFORMS = {  # Blender's name: (beginning, ends of the platform of a wheel)
    "linux-x64": ("manylinux", ("x86_64",)), "windows-x64": ("win", ("amd64",)),
    "macos-arm64": ("macosx", ("arm64", "universal2")), "macos-x64": ("macosx", ("x86_64", "universal2")),
}


def of_platform(platform: str) -> list[tuple[str, str, str, dict]]:
    """(distribution, version, tag, {"sha256", "download"}) of the wheels for one of PLATFORMS."""
    begin, ends = PLATFORMS[platform]
    pins = json.loads(PINS.read_text())["wheels"]
    return [(name, pins[name]["version"], tag, file) for name in SMALL for tag, file in pins[name]["files"].items()
            for python, abi, system in [tag.split("-")]
            if system.startswith(begin) and system.endswith(ends) and (abi == "abi3" or python in PYTHONS)]


def file_name(distribution: str, version: str, tag: str) -> str:
    return f"{distribution.replace('-', '_')}-{version}-{tag}.whl"


def fetch(platform: str, folder: Path) -> list[Path]:
    """The wheels for a platform as files in `folder`; those that are there are not downloaded again.

    Raises subprocess.CalledProcessError with pip's output, also where a file has not the pinned hash.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for name, version, tag, pin in of_platform(platform):
        path = folder / file_name(name, version, tag)
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != pin["sha256"]:
            path.unlink(missing_ok=True)
            _download(f"{name}=={version} --hash=sha256:{pin['sha256']}", tag, folder)
        found.append(path)
    return found


def _download(requirement: str, tag: str, folder: Path) -> None:
    python, abi, systems = tag.split("-")
    wanted = folder / "wanted.txt"
    wanted.write_text(requirement + "\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
               "--only-binary=:all:", "--require-hashes", "--requirement", str(wanted), "--dest", str(folder),
               "--implementation", "cp", "--python-version", python.removeprefix("cp"), "--abi", abi]
    command += [option for system in systems.split(".") for option in ("--platform", system)]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    finally:
        wanted.unlink()
