# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python packages that the network needs and Blender does not bring: found, asked for, never imported here.

They are taken from the running Python, or from a folder of our own that the Install operator fills. Blender's own
site-packages are never written to, and numpy always stays Blender's.
"""
from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import bpy

PACKAGES = {
    "torch": "torch==2.15.0",
    "safetensors": "safetensors==0.8.0",
    "fast_simplification": "fast-simplification==0.2.0",
}
NETWORK = ("torch", "safetensors")  # no picture without them; the rest is asked for where it is used
PUBLISHED = {  # to download and read the published weights
    "huggingface_hub": "huggingface_hub==2.4.0",
    "yaml": "PyYAML==6.0.3",
    "diffusers": "diffusers==0.42.1",
    "PIL": "Pillow==13.0.0",
}
WITH_DEPENDENCIES = ("torch", "huggingface_hub")  # the others would bring a numpy, or need only what is there
EXTENSION = __package__.rsplit(".", 2)[0]


class MissingPackages(Exception):
    """Packages cannot be imported; the message says how to get them."""


def is_extension() -> bool:
    """False when run from the source tree, where Blender has no folder for us."""
    return EXTENSION.startswith("bl_ext.")


def offline() -> str:
    """Why the network may not be used, or "" when the user allowed it."""
    if bpy.app.online_access:
        return ""
    if bpy.app.online_access_override:
        return "Blender was started in offline mode: start it again without --offline-mode"
    return "Allow Online Access in Preferences > System first"


def folder(create: bool = False) -> Path | None:
    """Our folder of packages, under Blender's path for this extension; None when run from the source tree."""
    if not is_extension():
        return None
    return Path(bpy.utils.extension_path_user(EXTENSION, path="runtime", create=create))


def missing(packages: dict[str, str] = PACKAGES) -> list[str]:
    """Import names of the packages (PACKAGES or PUBLISHED) that are not to be found."""
    own = folder()
    if own and own.is_dir() and str(own) not in sys.path:
        sys.path.append(str(own))  # behind Blender's packages: it must not replace any of them
        importlib.invalidate_caches()
    return [name for name in packages if importlib.util.find_spec(name) is None]


def require() -> None:
    """Raises MissingPackages when the network cannot run."""
    names = [name for name in missing() if name in NETWORK]
    if names:
        raise MissingPackages(
            f"Python packages are missing: {', '.join(names)}. Use Render Properties > RenderFormer-V2 > Install "
            f"Packages (PyTorch is a large download), or install them into Blender's Python: {sys.executable} -m pip "
            "install " + " ".join(PACKAGES[name] for name in names))


def install_commands(target: Path, packages: dict[str, str]) -> list[list[str]]:
    """pip commands that bring what is missing into `target`: prebuilt wheels only, and without numpy."""
    pip = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "--only-binary=:all:", "--upgrade",
           "--target", str(target)]
    names = missing(packages)
    alone = [packages[name] for name in names if name not in WITH_DEPENDENCIES]
    return ([[*pip, packages[name]] for name in names if name in WITH_DEPENDENCIES]
            + ([[*pip, "--no-deps", *alone]] if alone else []))
