# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the Python packages that the network needs and Blender does not include, without importing them.

They are taken from the running Python, or from a folder of our own that the Install operator fills. Blender's own
site-packages are never written to, and numpy always stays Blender's.
"""
from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

import bpy

import addon_utils

from ...model.errors import SceneError
from . import distributions, package_install, shared_folders, wheels

PACKAGES = {"torch": "torch", "safetensors": "safetensors", "fast_simplification": "fast-simplification",
            "embreex": "embreex"}
NETWORK = ("torch", "safetensors")  # no picture without them; the rest is asked for where it is used
MINIMUM = {"torch": "2.4", "safetensors": "0.4"}  # PyTorch has had rms_norm since then
PUBLISHED = {  # to download and read the published weights
    "huggingface_hub": "huggingface-hub", "yaml": "pyyaml", "diffusers": "diffusers", "PIL": "pillow",
}
EXTENSION = __package__.rsplit(".", 2)[0]

_seen: tuple[object, dict[str, str]] = (None, {})  # what state of the folder was looked at, and what was intact there


class MissingPackages(Exception):
    """Packages cannot be imported or used; the message says how to get them."""


def is_extension() -> bool:
    """False when run from the source tree, where Blender has no folder for us."""
    return EXTENSION.startswith("bl_ext.")


def preferences() -> bpy.types.AddonPreferences | None:
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon and addon.preferences


def offline() -> str:
    """Why the network may not be used, or "" when the user allowed it."""
    if bpy.app.online_access:
        return ""
    if bpy.app.online_access_override:
        return "Blender was started in offline mode: start it again without --offline-mode"
    return "Allow Online Access in Preferences > System first"


def folder(create: bool = False) -> Path | None:
    """Our folder of packages: the shared one, or under Blender's path for this extension.

    None when run from the source tree without a shared one.
    """
    if shared := shared_folders.named(shared_folders.PACKAGES):
        return shared
    if not is_extension():
        return None
    return Path(bpy.utils.extension_path_user(EXTENSION, path="runtime", create=create))


def look_again() -> None:
    """Forget what was seen in our folder: something was written there."""
    global _seen
    _seen = None, {}
    importlib.invalidate_caches()


def intact() -> dict[str, str]:
    """{distribution: version} of what lies complete in our folder; looked at again when something comes or goes."""
    global _seen
    if package_install.is_running():
        return _seen[1]  # what comes now is looked at when all is there
    own = folder()
    if own is None or not own.is_dir():
        return {}
    state = own, own.stat().st_mtime_ns
    if _seen[0] != state:
        _seen = state, distributions.intact(own)
    return _seen[1]


def elsewhere(name: str) -> Path | None:
    """The folder outside of ours where the running Python finds a package of this import name, if it does."""
    own = folder()
    if own and own.is_dir() and str(own) not in sys.path:
        sys.path.append(str(own))  # behind Blender's packages: it must not replace any of them
        importlib.invalidate_caches()
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:  # a folder without an __init__.py is the rest of something
        return None
    return None if own and Path(spec.origin).is_relative_to(own) else Path(spec.origin).parents[1]


def is_elsewhere(name: str) -> bool:
    """Whether the running Python has a package of this import name outside of our folder; that one is used then."""
    return elsewhere(name) is not None


@cache
def _version(distribution: str, folder: Path) -> str:
    """Of a distribution that lies there, or "" where nothing says so."""
    return next((found.version for found in metadata.distributions(name=distribution, path=[str(folder)])), "")


def version_elsewhere(name: str) -> str:
    """Of the package with this import name outside of our folder, or "" where there is none or nothing says so."""
    folder = elsewhere(name)
    return _version((PACKAGES | PUBLISHED)[name], folder) if folder else ""


def _numbers(version: str) -> list[int]:
    """[2, 4, 1] of "2.4.1+cu121"."""
    return [int(number) for number in re.findall(r"\d+", version.partition("+")[0])]


def too_old() -> str:
    """Which package outside of our folder is older than the MINIMUM, where it is and what to do; or ""."""
    for name, minimum in MINIMUM.items():
        version = version_elsewhere(name)
        if version and _numbers(version) < _numbers(minimum):
            update = f"{sys.executable} -m pip install --upgrade {wheels.requirement(PACKAGES[name])}"
            return (f"{name} {version} in {elsewhere(name)} is too old: this add-on needs {name} {minimum} or newer. "
                    f"Update it with {update}, or remove it and use Render Properties > RenderFormer-V2 > Install "
                    "Packages. Then start Blender again")
    return ""


def is_complete(distribution: str) -> bool:
    """Whether our folder has it with all that it needs, of either build and in the pinned versions."""
    have = intact()

    def has(build: str) -> bool:
        try:
            return all(wheels.public(have.get(wheel.name, "")) == wheels.public(wheel.version)
                       for wheel in wheels.needed(distribution, build))
        except (wheels.NoWheel, KeyError):  # not made for this computer, or not pinned
            return False

    return any(map(has, wheels.BUILDS))


def is_offered(name: str, distribution: str) -> bool:
    """Whether a package is asked for on this computer: one that is only useful is not where no wheel of it is made."""
    return name in NETWORK or wheels.is_made(distribution)


def missing(packages: dict[str, str] = PACKAGES) -> list[str]:
    """Import names of the packages (PACKAGES or PUBLISHED) that are not to be found, or damaged."""
    return [name for name, distribution in packages.items()
            if is_offered(name, distribution) and not is_elsewhere(name) and not is_complete(distribution)]


def installed() -> list[str]:
    """Import names of the packages that lie in our folder, damaged or not."""
    own = folder()
    there = distributions.infos(own) if own else {}
    return [name for name, distribution in (PACKAGES | PUBLISHED).items() if distribution in there]


def build() -> str:
    """The build of PyTorch that the preferences ask for: CUDA or CPU."""
    return wheels.build(preferences().torch_build if preferences() else "AUTO")


def cuda_release() -> str:
    """That of PyTorch's CUDA build for Windows."""
    return wheels.release_of(preferences().torch_cuda_index) if preferences() else wheels.CUDA


def installed_build() -> str:
    """Which build of PyTorch is there: "CPU", "CUDA 13.2", "ROCm 7.1", or "" for none or an unknown one."""
    found = elsewhere("torch") or folder()
    try:
        text = (found / "torch" / "version.py").read_text(encoding="utf-8")
    except (OSError, TypeError):
        return ""
    for name, pattern in (("CUDA", r"^cuda\b.*=\s*'([\d.]+)'"), ("ROCm", r"^hip\b.*=\s*'([\d.]+)")):
        if match := re.search(pattern, text, re.MULTILINE):
            return f"{name} {match[1]}"
    return "CPU" if re.search(r"^cuda\b.*=\s*None", text, re.MULTILINE) else ""


def wanted(names: Iterable[str]) -> list[wheels.Wheel]:
    """Everything that our folder should have for these packages, in the build of the preferences. Raises NoWheel."""
    known, found = PACKAGES | PUBLISHED, {}
    for name in names:
        if is_offered(name, known[name]) and not is_elsewhere(name):
            found |= {wheel.name: wheel for wheel in wheels.needed(known[name], build(), cuda_release())}
    return list(found.values())


def lacking(names: Iterable[str]) -> list[wheels.Wheel]:
    """Those of wanted(names) that are not there. Raises NoWheel."""
    have = intact()
    return [wheel for wheel in wanted(names) if have.get(wheel.name) != wheel.version]


def other_build() -> str:
    """The build of PyTorch in the preferences, if our folder has a complete one of another; else ""."""
    try:
        return build() if is_complete("torch") and lacking(["torch"]) else ""
    except wheels.NoWheel:
        return ""


def refusal() -> str:
    """Why nothing can be installed now, or ""."""
    if message := offline():
        return message
    if folder() is None:
        return "The add-on runs from its source folder: install the packages into this Python"
    if package_install.is_running():
        return "The packages are being installed"
    return "A render is running" if bpy.app.is_job_running("RENDER") else ""


def unavailable(names: Iterable[str]) -> str:
    """Why these packages can never be installed into this Python, and what to do; or ""."""
    try:
        wanted(names)
    except wheels.NoWheel as error:
        return str(error)
    return ""


def require() -> None:
    """Raises MissingPackages when the network cannot run."""
    if problem := too_old():
        raise MissingPackages(problem)
    names = [name for name in missing() if name in NETWORK]
    if names:
        if problem := unavailable(names):
            raise MissingPackages(problem)
        if shared := shared_folders.named(shared_folders.PACKAGES):
            raise MissingPackages(
                f"Python packages are missing or incomplete in {shared}: {', '.join(names)}. The environment variable "
                f"{shared_folders.PACKAGES} names this folder: correct it, or fill it with blender --online-mode "
                "--command renderformer_v2 install")
        raise MissingPackages(
            f"Python packages are missing or incomplete: {', '.join(names)}. Use Render Properties > RenderFormer-V2 > "
            f"Install Packages (PyTorch is a large download), or install them into Blender's Python: {sys.executable} "
            "-m pip install " + " ".join(wheels.requirement(PACKAGES[name]) for name in names))


def require_cycles() -> None:
    """Raises SceneError when Blender's Cycles add-on is switched off."""
    if not addon_utils.check("cycles")[1]:
        raise SceneError("RenderFormer-V2 needs Blender's Cycles add-on to find what the camera sees: "
                         "enable 'Cycles Render Engine' in Preferences > Add-ons")
