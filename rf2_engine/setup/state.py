# SPDX-License-Identifier: GPL-3.0-or-later
"""What is set up on this computer and what is missing, for those who look at it without a window."""
from __future__ import annotations

import platform
from pathlib import Path

import bpy

from ...model.errors import CheckpointError, SceneError
from ...model.published.bundle_files import check_weights, is_bundle
from ...model.weights.presets import BUNDLED, weights_folder
from . import importing, packages, published_weights, wheels


def status(weights: str = BUNDLED) -> dict:
    """Versions, packages, device, weights, and under "problems" what keeps a frame from being rendered with `weights`.

    weights: BUNDLED, "published", or a folder.
    """
    problems: list[str] = []
    found = {"blender": bpy.app.version_string, "python": platform.python_version(),
             "system": f"{platform.system()} {platform.machine()}", "packages": _packages(),
             "missing": packages.missing(), "packages_folder": _text(packages.folder()),
             "published_weights": _text(published_weights.bundle_folder()),
             "device": _device(problems), "weights": _weights(weights, problems)}
    try:
        packages.require_cycles()
    except SceneError as error:
        problems.append(str(error))
    return found | {"problems": problems, "ready": not problems}


def _packages() -> dict[str, str]:
    """{import name: version} of those that are there, "" where nothing says which."""
    known, own = packages.PACKAGES | packages.PUBLISHED, packages.intact()
    return {name: packages.version_elsewhere(name) or own.get(distribution, "")
            for name, distribution in known.items() if distribution in own or packages.is_elsewhere(name)}


def _device(problems: list[str]) -> str:
    """What Automatic chooses here, or ""."""
    try:
        packages.require()
        importing.import_packages()
    except packages.MissingPackages as error:
        problems.append(str(error))
        return ""
    from ...model.compute.devices import choose_device, unused_card
    device = str(choose_device())
    reason = "" if device.startswith("cuda") else unused_card(wheels.has_nvidia_driver())
    return f"{device}; {reason}" if reason else device


def _weights(wanted: str, problems: list[str]) -> str:
    """The preset or the folder, as far as one is known."""
    try:
        if wanted == "published":
            return str(published_weights.require())
        check_weights(weights_folder(wanted))
        if wanted != BUNDLED and is_bundle(wanted) and (parts := published_weights.missing_parts(Path(wanted))):
            raise CheckpointError(f"The published weights are not complete in {wanted}: {', '.join(parts)}")
    except CheckpointError as error:
        problems.append(str(error))
    return wanted


def _text(folder: Path | None) -> str:
    return str(folder) if folder else ""
