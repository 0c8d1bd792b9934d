# SPDX-License-Identifier: GPL-3.0-or-later
"""The small wheels that an extension package brings along, by Blender's platform: pinned, downloaded by pip, hashed."""
from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

from ..extension import ROOT

PINS = ROOT / "rf2_engine" / "setup" / "wheels.json"
SMALL = ("safetensors", "fast-simplification", "embreex")  # numpy is Blender's; PyTorch is too large to bring along
LICENSES = ("SPDX:Apache-2.0", "SPDX:BSD-2-Clause", "SPDX:MIT")  # theirs, and of the libraries in them
PYTHONS = ("cp311", "cp313")  # of Blender 4.5 to 5.0, and from 5.1 on; a distribution may have another
PLATFORMS = {  # Blender's name: (beginning, ends of the platform of a wheel)
    "linux-x64": ("manylinux", ("x86_64",)), "windows-x64": ("win", ("amd64",)),
    "macos-arm64": ("macosx", ("arm64", "universal2")), "macos-x64": ("macosx", ("x86_64", "universal2")),
}


def pins() -> dict:
    """{distribution: {"version", "files": {tag: {"sha256", "download", "unpacked"}}}}"""
    return json.loads(PINS.read_text())["wheels"]


def _suits_platform(platform: str, system: str) -> bool:
    begin, ends = PLATFORMS[platform]
    return system.startswith(begin) and system.endswith(ends)


def find_small(platform: str) -> list[tuple[str, str, str, dict]]:
    """(distribution, version, tag, {"sha256", "download"}) of the small wheels for one of PLATFORMS."""
    pinned = pins()
    return [(name, pinned[name]["version"], tag, file) for name in SMALL for tag, file in pinned[name]["files"].items()
            for python, abi, system in [tag.split("-")]
            if _suits_platform(platform, system) and (abi == "abi3" or python in PYTHONS)]


def find_fitting(platform: str, python: str) -> list[tuple[str, str, str, dict]]:
    """The same of all pinned distributions for one of PLATFORMS and PYTHONS, the best wheel of each.

    The builds of PyTorch that have their own index have no hash and are left out.
    """
    wheels = []
    for name, pin in pins().items():
        tags = [tag for tag in pin["files"] if _fits(tag, platform, python)]
        if tags and "+" not in name:
            best = min(tags, key=lambda tag: (tag.endswith("any"), tag.split("-")[0] != python))
            wheels.append((name, pin["version"], best, pin["files"][best]))
    return wheels


def _fits(tag: str, platform: str, python: str) -> bool:
    made_for, abi, system = tag.split("-")
    if system != "any" and not _suits_platform(platform, system):
        return False
    if abi == "none":
        return "py3" in made_for
    return python == abi or abi == "abi3" and int(made_for.removeprefix("cp3")) <= int(python.removeprefix("cp3"))


def file_name(distribution: str, version: str, tag: str) -> str:
    return f"{distribution.replace('-', '_')}-{version}-{tag}.whl"


def fetch(platform: str, folder: Path) -> list[Path]:
    """The wheels for a platform as files in `folder`; those that are there are not downloaded again.

    Raises subprocess.CalledProcessError with pip's output, also where a file has not the pinned hash.
    """
    return [fetch_one(name, version, tag, pin["sha256"], folder) for name, version, tag, pin in find_small(platform)]


def fetch_one(name: str, version: str, tag: str, sha256: str, folder: Path, python: str = "") -> Path:
    """One wheel as a file in `folder`. python: for what runs with any, one of PYTHONS. Raises as `fetch` does."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file_name(name, version, tag)
    if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        path.unlink(missing_ok=True)
        _download(f"{name}=={version} --hash=sha256:{sha256}", tag, folder, python)
    return path


def _download(requirement: str, tag: str, folder: Path, any_python: str = "") -> None:
    python, abi, systems = tag.split("-")
    python = python if python.startswith("cp") else any_python
    requirements = folder / "wanted.txt"
    requirements.write_text(requirement + "\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
               "--only-binary=:all:", "--require-hashes", "--requirement", str(requirements), "--dest", str(folder),
               "--implementation", "cp", "--python-version", python.removeprefix("cp"), "--abi", abi]
    command += [option for system in systems.split(".") for option in ("--platform", system)]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    finally:
        requirements.unlink()
