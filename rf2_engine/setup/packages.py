# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the Python packages that the network needs and Blender does not include, without importing them.

They come from the running Python, or from a folder of our own that the Install operator fills. Blender's own
site-packages are never written to, and numpy always stays Blender's. The environment can name folders for packages and
weights that many machines or users share.
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
from . import distributions, extension, package_install, wheels

PACKAGES = {"torch": "torch", "safetensors": "safetensors", "fast_simplification": "fast-simplification",
            "embreex": "embreex"}
NETWORK = ("torch", "safetensors")  # no picture without them; the others are required where they are used
MINIMUM = {"torch": "2.4", "safetensors": "0.4"}  # PyTorch has had rms_norm since then
PUBLISHED = {  # to download and read the published weights
    "huggingface_hub": "huggingface-hub", "yaml": "pyyaml", "diffusers": "diffusers", "PIL": "pillow",
}

PACKAGES_VARIABLE = "RENDERFORMER_V2_PACKAGES"  # environment: folder of Python packages, as Install Packages makes it

BUTTON = "Render Properties > RenderFormer-V2 > Install Packages"


class MissingPackages(Exception):
    """Packages cannot be imported or used; the message says how to get them."""


class FolderContents:
    """What our folder of packages holds, cached until the folder changes. There is one: `_contents`."""

    def __init__(self):
        self.forget()

    def forget(self) -> None:
        self._state, self._intact = None, {}

    def intact(self) -> dict[str, str]:
        """{distribution: version} of what is complete in the folder; as it was before while something is installed."""
        if package_install.current.is_running:
            return self._intact
        own = folder()
        if own is None or not own.is_dir():
            return {}
        state = own, own.stat().st_mtime_ns
        if self._state != state:
            self._state, self._intact = state, distributions.find_intact(own)
        return self._intact


_contents = FolderContents()
intact = _contents.intact


def folder(create: bool = False) -> Path | None:
    """Our folder of packages: the shared one, or under Blender's path for this extension.

    None when run from the source tree without a shared one.
    """
    return extension.shared_folder(PACKAGES_VARIABLE) or extension.user_folder("runtime", create)


def refresh() -> None:
    """Look into our folder again: something was installed."""
    _contents.forget()
    importlib.invalidate_caches()


def elsewhere(name: str) -> Path | None:
    """The folder outside of ours where Python finds a package of this import name, if any."""
    own = folder()
    if own and own.is_dir() and str(own) not in sys.path:
        sys.path.append(str(own))  # after Blender's packages, so that it replaces none of them
        importlib.invalidate_caches()
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:  # a folder without __init__.py is a leftover
        return None
    return None if own and Path(spec.origin).is_relative_to(own) else Path(spec.origin).parents[1]


def is_elsewhere(name: str) -> bool:
    """Whether Python has a package of this import name outside of our folder, which is then used."""
    return elsewhere(name) is not None


@cache
def _version(distribution: str, folder: Path) -> str:
    """The version of a distribution in a folder, or "" where it is unknown."""
    return next((candidate.version for candidate in metadata.distributions(name=distribution, path=[str(folder)])), "")


def version_elsewhere(name: str) -> str:
    """The version of the package with this import name outside of our folder, or "" where none is known."""
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
            other = f", or remove it and use {BUTTON}" if can_install([name]) else ""
            return (f"{name} {version} in {elsewhere(name)} is too old: this add-on needs {name} {minimum} or newer. "
                    f"Update it with {update}{other}. Then start Blender again")
    return ""


def is_complete(distribution: str) -> bool:
    """Whether our folder has a distribution and all that it needs, of one build and in the pinned versions."""
    have = intact()

    def has(build: str) -> bool:
        try:
            return all(wheels.public_version(have.get(wheel.name, "")) == wheels.public_version(wheel.version)
                       for wheel in wheels.find_wheels(distribution, build))
        except (wheels.NoWheel, KeyError):  # no wheel for this computer, or not pinned
            return False

    return any(map(has, wheels.BUILDS))


def is_offered(name: str, distribution: str) -> bool:
    """Whether a package is required on this computer; an optional one is not if it has no wheel for it."""
    return name in NETWORK or wheels.is_made(distribution)


def missing(packages: dict[str, str] = PACKAGES) -> list[str]:
    """Import names of the packages (PACKAGES or PUBLISHED) that are missing or damaged."""
    return [name for name, distribution in packages.items()
            if is_offered(name, distribution) and not is_elsewhere(name) and not is_complete(distribution)]


def installed() -> list[str]:
    """Import names of the packages in our folder, damaged or not."""
    own = folder()
    existing = distributions.find_infos(own) if own else {}
    return [name for name, distribution in (PACKAGES | PUBLISHED).items() if distribution in existing]


def build() -> str:
    """The build of PyTorch chosen in the preferences: CUDA or CPU."""
    preferences = extension.preferences()
    return wheels.choose_build(preferences.torch_build if preferences else "AUTO")


def cuda_release() -> str:
    """The release of CUDA ("cu132") of PyTorch's build for Windows."""
    preferences = extension.preferences()
    return wheels.parse_cuda_release(preferences.torch_cuda_index) if preferences else wheels.CUDA


def installed_build() -> str:
    """The build of PyTorch that is installed: "CPU", "CUDA 13.2", "ROCm 7.1", or "" for none or an unknown one."""
    location = elsewhere("torch") or folder()
    try:
        text = (location / "torch" / "version.py").read_text(encoding="utf-8")
    except (OSError, TypeError):
        return ""
    for name, pattern in (("CUDA", r"^cuda\b.*=\s*'([\d.]+)'"), ("ROCm", r"^hip\b.*=\s*'([\d.]+)")):
        if match := re.search(pattern, text, re.MULTILINE):
            return f"{name} {match[1]}"
    return "CPU" if re.search(r"^cuda\b.*=\s*None", text, re.MULTILINE) else ""


def required_wheels(names: Iterable[str]) -> list[wheels.Wheel]:
    """All that our folder should have for these packages, in the build of the preferences. Raises NoWheel."""
    all_packages, required = PACKAGES | PUBLISHED, {}
    for name in names:
        if is_offered(name, all_packages[name]) and not is_elsewhere(name):
            package_wheels = wheels.find_wheels(all_packages[name], build(), cuda_release())
            required |= {wheel.name: wheel for wheel in package_wheels}
    return list(required.values())


def missing_wheels(names: Iterable[str]) -> list[wheels.Wheel]:
    """The wheels of required_wheels(names) that are not there. Raises NoWheel."""
    have = intact()
    return [wheel for wheel in required_wheels(names) if have.get(wheel.name) != wheel.version]


def other_build() -> str:
    """The build of PyTorch in the preferences, if our folder has a complete one of another; else ""."""
    try:
        return build() if is_complete("torch") and missing_wheels(["torch"]) else ""
    except wheels.NoWheel:
        return ""


def refusal() -> str:
    """Why nothing can be installed now, or ""."""
    if message := extension.offline():
        return message
    if folder() is None:
        return "The add-on runs from its source folder: install the packages into this Python"
    if package_install.current.is_running:
        return "The packages are being installed"
    return "A render is running" if bpy.app.is_job_running("RENDER") else ""


def unavailable(names: Iterable[str]) -> str:
    """Why these packages can never be installed into this Python, and what to do; or ""."""
    try:
        required_wheels(names)
    except wheels.NoWheel as error:
        return str(error)
    return ""


def can_install(names: Iterable[str]) -> bool:
    """Whether BUTTON can get these packages of PACKAGES: there is a folder for them and they are made."""
    return folder() is not None and all(wheels.is_made(PACKAGES[name]) for name in names)


def require() -> None:
    """Raises MissingPackages when the network cannot run."""
    if problem := too_old():
        raise MissingPackages(problem)
    names = [name for name in missing() if name in NETWORK]
    if names:
        if problem := unavailable(names):
            raise MissingPackages(problem)
        if shared := extension.shared_folder(PACKAGES_VARIABLE):
            raise MissingPackages(
                f"Python packages are missing or incomplete in {shared}: {', '.join(names)}. The environment variable "
                f"{PACKAGES_VARIABLE} names this folder: correct it, or fill it with blender --online-mode "
                "--command renderformer_v2 install")
        button = f"Use {BUTTON} (PyTorch is a large download), or install" if can_install(names) else "Install"
        raise MissingPackages(
            f"Python packages are missing or incomplete: {', '.join(names)}. {button} them into Blender's Python: "
            f"{sys.executable} -m pip install " + " ".join(wheels.requirement(PACKAGES[name]) for name in names))


def require_cycles() -> None:
    """Raises SceneError when Blender's Cycles add-on is switched off."""
    if not addon_utils.check("cycles")[1]:
        raise SceneError("RenderFormer-V2 needs Blender's Cycles add-on to find what the camera sees: "
                         "enable 'Cycles Render Engine' in Preferences > Add-ons")
