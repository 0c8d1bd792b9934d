# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the extension zip with Blender's own extension command, and validate it.

    python -m tools.build [-o FOLDER]

Works with the bpy wheel, which ships the program behind `blender --command extension`.
"""
from __future__ import annotations

import argparse
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

from .extension import ROOT


def extension_command() -> Path:
    """blender_ext.py of the installed bpy wheel. Raises FileNotFoundError without one."""
    spec = find_spec("bpy")
    places = Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py") if spec else ()
    for path in places:
        return path
    raise FileNotFoundError("Blender's extension command was not found: install the bpy wheel (make render does)")


def build(folder: Path) -> Path:
    """The validated zip, made in `folder`. Raises subprocess.CalledProcessError with the command's output."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    archive = folder / f"{manifest['id']}-{manifest['version']}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    _run("build", "--source-dir", str(ROOT), "--output-filepath", str(archive))
    _run("validate", str(archive))
    return archive


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, str(extension_command()), *arguments], check=True, capture_output=True, text=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.build", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build", help="folder of the zip (default: build)")
    arguments = parser.parse_args()
    try:
        archive = build(arguments.output)
    except subprocess.CalledProcessError as error:
        print(error.stdout + error.stderr, file=sys.stderr)
        return 1
    print(f"{archive} ({archive.stat().st_size / 1e6:.1f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
