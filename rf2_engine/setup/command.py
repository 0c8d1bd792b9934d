# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender --command renderformer_v2`: set-up without a window, for farms and containers (docs/farm.md 3)."""
from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from pathlib import Path

import bpy

from ...model.errors import CheckpointError, SceneError
from ...model.published.bundle_files import check_weights, is_bundle
from ...model.weights.presets import BUNDLED, weights_folder
from . import extension, importing, packages, published_weights, wheels
from .display import format_size

NAME = "renderformer_v2"


def run(arguments: list[str]) -> int:
    """The exit status: 0 when all is well, 1 when something is missing or failed, 2 for wrong arguments."""
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as end:  # would end Blender
        return end.code or 0
    try:
        return options.run(options)
    except (RuntimeError, ValueError, OSError, wheels.NoWheel) as error:  # operators raise RuntimeError
        print(f"RenderFormer-V2: {' '.join(str(error).removeprefix('Error: ').split())}", file=sys.stderr, flush=True)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"blender --command {NAME}", description="Set RenderFormer-V2 up.")
    commands = parser.add_subparsers(required=True, metavar="install | status")
    install = commands.add_parser("install", help="install what is missing (blender --online-mode --command ...)")
    install.add_argument("--build", choices=("auto", "cpu", "cuda"),
                         help="build of PyTorch on Linux and Windows, also for later")
    weights = install.add_mutually_exclusive_group()
    weights.add_argument("--weights", type=Path, metavar="DIR", help="use the published weights in this folder")
    weights.add_argument("--download", action="store_true",
                         help="download the published weights; HF_TOKEN is the access token, if one is needed")
    install.set_defaults(run=_install)
    status = commands.add_parser("status", help="one line of JSON; exit status 0 when a frame can be rendered")
    status.add_argument("--weights", default=BUNDLED, metavar="DIR",
                        help=f"which are to be used: {BUNDLED} (default), published, or a folder")
    status.set_defaults(run=_status)
    return parser


def _status(options: argparse.Namespace) -> int:
    setup = describe_setup(options.weights)
    print(json.dumps(setup), flush=True)
    return 0 if setup["ready"] else 1


def _install(options: argparse.Namespace) -> int:
    preferences = extension.preferences()
    if preferences is None:
        raise ValueError("the add-on is not enabled in Blender's preferences: blender --command extension install-file "
                         "-r user_default -e FILE.zip")
    if options.weights:
        _choose_weights(preferences, options.weights.expanduser().absolute())
    if options.build:
        preferences.torch_build = options.build.upper()
    if options.build or options.weights:
        bpy.ops.wm.save_userpref()
    _install_packages(packages.PACKAGES)
    if options.download or options.weights:
        _install_packages(packages.PUBLISHED, published=True)
    if options.download:
        _download()
    print("RenderFormer-V2: ready", flush=True)
    return 0


def _choose_weights(preferences: bpy.types.AddonPreferences, folder: Path) -> None:
    """Set the folder of the published weights. Raises ValueError if they are incomplete."""
    if parts := published_weights.missing_parts(folder):
        raise ValueError(f"{folder} does not hold the published weights: {', '.join(parts)} is missing")
    preferences.weights_folder = str(folder)


def _install_packages(group: dict[str, str], published: bool = False) -> None:
    missing = packages.missing(group)
    if missing or (not published and packages.other_build()):
        needed = packages.missing_wheels(missing or group)
        print(f"RenderFormer-V2: installing {len(needed)} packages, "
              f"{format_size(sum(wheel.download for wheel in needed))} to download", flush=True)
        _require_online_access()
        bpy.ops.renderformer_v2.install_packages(published=published)


def _download() -> None:
    if parts := _missing_weights():
        print(f"RenderFormer-V2: downloading the published weights: {', '.join(parts)}", flush=True)
        _require_online_access()
        extension.preferences().access_token = os.environ.get("HF_TOKEN", "")
        bpy.ops.renderformer_v2.download_weights()
        bpy.ops.renderformer_v2.fetch_weights()


def _missing_weights() -> list[str]:
    bundle = published_weights.bundle_folder()
    return published_weights.missing_parts(bundle) if bundle else ["all"]


def _require_online_access() -> None:
    """Raises ValueError if the user has not allowed network access."""
    if reason := extension.offline():
        raise ValueError(f"{reason}, or start it as blender --online-mode --command {NAME} install")


def describe_setup(weights: str = BUNDLED) -> dict:
    """Versions, packages, device and weights of this computer, and under "problems" what prevents a render.

    weights: those to be used: BUNDLED, "published", or a folder.
    """
    problems: list[str] = []
    setup = {"blender": bpy.app.version_string, "python": platform.python_version(),
             "system": f"{platform.system()} {platform.machine()}", "packages": _package_versions(),
             "missing": packages.missing(), "packages_folder": _text(packages.folder()),
             "published_weights": _text(published_weights.bundle_folder()),
             "device": _find_device(problems), "weights": _find_weights(weights, problems)}
    try:
        packages.require_cycles()
    except SceneError as error:
        problems.append(str(error))
    return setup | {"problems": problems, "ready": not problems}


def _package_versions() -> dict[str, str]:
    """{import name: version} of existing packages, "" where the version is unknown."""
    all_packages, own = packages.PACKAGES | packages.PUBLISHED, packages.intact()
    return {name: packages.version_elsewhere(name) or own.get(distribution, "")
            for name, distribution in all_packages.items() if distribution in own or packages.is_elsewhere(name)}


def _find_device(problems: list[str]) -> str:
    """The device that Automatic chooses here, or ""."""
    try:
        packages.require()
        importing.import_packages()
    except packages.MissingPackages as error:
        problems.append(str(error))
        return ""
    from ...model.compute.devices import choose_device, explain_unused_card
    device = str(choose_device())
    reason = "" if device.startswith("cuda") else explain_unused_card(wheels.has_nvidia_driver())
    return f"{device}; {reason}" if reason else device


def _find_weights(weights: str, problems: list[str]) -> str:
    """The preset or the folder of the weights."""
    try:
        if weights == "published":
            return str(published_weights.require())
        check_weights(weights_folder(weights))
        if weights != BUNDLED and is_bundle(weights) and (parts := published_weights.missing_parts(Path(weights))):
            raise CheckpointError(f"The published weights are not complete in {weights}: {', '.join(parts)}")
    except CheckpointError as error:
        problems.append(str(error))
    return weights


def _text(folder: Path | None) -> str:
    return str(folder) if folder else ""


_handles: list = []


def register() -> None:
    _handles.append(bpy.utils.register_cli_command(NAME, run))


def unregister() -> None:
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
