# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender --command renderformer_v2`: set-up without a window, for farms and containers (docs/farm.md 3)."""
from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import bpy

from ...model.weights.presets import BUNDLED
from . import packages, published_weights, state, wheels
from .display import amount

NAME = "renderformer_v2"


def run(arguments: list[str]) -> int:
    """The exit status: 0 when all is well, 1 when something is missing or failed, 2 for wrong arguments."""
    try:
        chosen = _parser().parse_args(arguments)
    except SystemExit as end:  # which would end Blender in the middle of its work
        return end.code or 0
    try:
        return chosen.run(chosen)
    except (RuntimeError, ValueError, OSError, wheels.NoWheel) as error:  # RuntimeError is what operators report
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


def _status(chosen: argparse.Namespace) -> int:
    found = state.status(chosen.weights)
    print(json.dumps(found), flush=True)
    return 0 if found["ready"] else 1


def _install(chosen: argparse.Namespace) -> int:
    kept = packages.preferences()
    if kept is None:
        raise ValueError("the add-on is not enabled in Blender's preferences: blender --command extension install-file "
                         "-r user_default -e FILE.zip")
    if chosen.weights:
        _choose_weights(kept, chosen.weights.expanduser().absolute())
    if chosen.build:
        kept.torch_build = chosen.build.upper()
    if chosen.build or chosen.weights:
        bpy.ops.wm.save_userpref()
    _install_packages(packages.PACKAGES)
    if chosen.download or chosen.weights:
        _install_packages(packages.PUBLISHED, published=True)
    if chosen.download:
        _download()
    print("RenderFormer-V2: ready", flush=True)
    return 0


def _choose_weights(kept: bpy.types.AddonPreferences, folder: Path) -> None:
    """In the preferences. Raises ValueError when they are not complete."""
    if parts := published_weights.missing_parts(folder):
        raise ValueError(f"{folder} does not hold the published weights: {', '.join(parts)} is missing")
    kept.weights_folder = str(folder)


def _install_packages(group: dict[str, str], published: bool = False) -> None:
    missing = packages.missing(group)
    if missing or (not published and packages.other_build()):
        wanted = packages.missing_wheels(missing or group)
        print(f"RenderFormer-V2: installing {len(wanted)} packages, "
              f"{amount(sum(wheel.download for wheel in wanted))} to download", flush=True)
        _allowed()
        bpy.ops.renderformer_v2.install_packages(published=published)


def _download() -> None:
    if parts := _missing_weights():
        print(f"RenderFormer-V2: downloading the published weights: {', '.join(parts)}", flush=True)
        _allowed()
        packages.preferences().access_token = os.environ.get("HF_TOKEN", "")
        bpy.ops.renderformer_v2.download_weights()
        bpy.ops.renderformer_v2.fetch_weights()


def _missing_weights() -> list[str]:
    bundle = published_weights.bundle_folder()
    return published_weights.missing_parts(bundle) if bundle else ["all"]


def _allowed() -> None:
    """Raises ValueError where the user has not allowed the network."""
    if reason := packages.offline():
        raise ValueError(f"{reason}, or start it as blender --online-mode --command {NAME} install")


_handles: list = []


def register() -> None:
    _handles.append(bpy.utils.register_cli_command(NAME, run))


def unregister() -> None:
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
