# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the extension with Blender's own extension command, and validate it: a zip for each platform.

    python -m tools.build [-o FOLDER]                    with the small wheels of each platform, which pip downloads
    python -m tools.build --without-wheels [-o FOLDER]   one for all platforms, without a network

Works with the bpy wheel, which ships the program behind `blender --command extension`.
"""
from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

from .common import wheel_files
from .extension import ROOT

MANIFEST = "blender_manifest.toml"


def extension_command() -> Path:
    """blender_ext.py of the installed bpy wheel. Raises FileNotFoundError without one."""
    spec = find_spec("bpy")
    paths = Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py") if spec else ()
    for path in paths:
        return path
    raise FileNotFoundError("Blender's extension command was not found: install the bpy wheel (make render does)")


def build(folder: Path) -> Path:
    """The validated zip without wheels, made in `folder`.

    Raises subprocess.CalledProcessError with the command's output.
    """
    archive = folder / f"{_package_name()}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    _run("build", "--source-dir", str(ROOT), "--output-filepath", str(archive))
    _run("validate", str(archive))
    return archive


def build_for(platform: str, wheels: list[Path], folder: Path) -> Path:
    """The validated zip for one of wheel_files.PLATFORMS, with these wheels. Raises as `build` does."""
    archive = folder / f"{_package_name()}-{platform.replace('-', '_')}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="renderformer-v2-build-") as temporary:
        source = Path(temporary) / "source"
        with ZipFile(build(Path(temporary))) as plain:
            plain.extractall(source)
        (source / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy(wheel, source / "wheels")
        text = (source / MANIFEST).read_text()
        (source / MANIFEST).write_text(make_manifest(text, platform, [wheel.name for wheel in wheels]))
        _run("build", "--source-dir", str(source), "--output-filepath", str(archive))
    _run("validate", str(archive))
    return archive


def make_manifest(text: str, platform: str, wheels: list[str]) -> str:
    """The manifest of a package for one platform, with the names and licences of the wheels that it brings along."""
    licenses = tomllib.loads(text)["license"]
    lines = [line for line in text.splitlines() if not line.startswith("license = ")]
    at = lines.index("[permissions]")
    listed = {"license": [*licenses, *wheel_files.LICENSES], "platforms": [platform],
              "wheels": [f"./wheels/{name}" for name in wheels]}
    return "\n".join(lines[:at] + [f"{key} = {json.dumps(value)}" for key, value in listed.items()] + lines[at:]) + "\n"


def _package_name() -> str:
    manifest_values = tomllib.loads((ROOT / MANIFEST).read_text())
    return f"{manifest_values['id']}-{manifest_values['version']}"


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, str(extension_command()), *arguments], check=True, capture_output=True, text=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.build", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build", help="folder of the zips (default: build)")
    parser.add_argument("--without-wheels", action="store_true", help="one zip that downloads all packages later")
    arguments = parser.parse_args()
    try:
        if arguments.without_wheels:
            _report(build(arguments.output))
            return 0
        for platform in wheel_files.PLATFORMS:
            _report(build_for(platform, wheel_files.fetch(platform, arguments.output / "wheels"), arguments.output))
    except subprocess.CalledProcessError as error:
        print(error.stdout + error.stderr, file=sys.stderr)
        return 1
    return 0


def _report(archive: Path) -> None:
    print(f"{archive} ({archive.stat().st_size / 1e6:.1f} MB)", flush=True)


if __name__ == "__main__":
    sys.exit(main())
