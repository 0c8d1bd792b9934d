# SPDX-License-Identifier: GPL-3.0-or-later
"""Install the pinned wheels of systems that are not this one into folders, and look into them.

    python -m tools.check_wheels FOLDER [--platforms windows-x64,macos-arm64] [--pythons cp311] [--leave-out nvidia-]

pip downloads each wheel by its tags and compares it with its hash; package_worker.py unpacks it and moves it to its
place. Then, for each system and Python: whether everything is there by RECORD; whether every compiled file is made for
the system; whether all libraries that its modules load are in the folder, in Python or in the system, by name; and how
long the paths are on Windows. A line of JSON for each; exit status 1 if anything is wrong. Only Blender on that system
can tell whether it imports.
"""
from __future__ import annotations

import argparse
import json
import shutil
import struct
import sys
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from .common import wheel_files
from .common.binaries import Binary, read_binary
from .extension import ROOT

sys.path.append(str(ROOT / "rf2_engine" / "setup"))  # these are parts of a program, not of a package
import distributions  # noqa: E402
import package_worker  # noqa: E402

# The longest folder on Windows: a user's name of 20 characters.
WINDOWS = (r"C:\Users\12345678901234567890\AppData\Roaming\Blender Foundation\Blender\5.2\extensions\.user\user_default"
           r"\renderformer_v2\runtime" "\\")
LONGEST = 259  # characters
MACHINES = {"linux-x64": ("linux", "x86_64"), "windows-x64": ("win", "amd64"), "macos-arm64": ("macosx", "arm64"),
            "macos-x64": ("macosx", "x86_64")}
MODULES = {"linux": (".so",), "win": (".pyd",), "macosx": (".so",)}
LIBRARIES = {"linux": (".so",), "win": (".dll",), "macosx": (".dylib",)}
# What Blender's Python or the system has; libcuda is the driver's.
PRESENT = {
    "linux": ("libc.so", "libm.so", "libdl.so", "libpthread.so", "librt.so", "libutil.so", "libgcc_s.so",
              "libstdc++.so", "ld-linux", "libcuda.so", "libz.so"),
    "win": ("api-ms-win-", "kernel32", "user32", "advapi32", "ws2_32", "shell32", "ole32", "oleaut32", "bcrypt",
            "ntdll", "dbghelp", "psapi", "shlwapi", "gdi32", "iphlpapi", "crypt32", "version.dll", "winmm",
            "userenv", "rpcrt4", "cfgmgr32", "setupapi", "powrprof", "secur32", "mswsock", "comdlg32", "wintrust",
            "imagehlp", "python3", "vcruntime140", "msvcp140", "ucrtbase", "vcomp140"),
    "macosx": ("/usr/lib/", "/system/library/"),
}


def install(wheel: Path, name: str, version: str, target: Path) -> None:
    """Install as package_worker does after its download. Raises ExplainedError for an incomplete wheel."""
    staging = target / distributions.STAGING
    staging.mkdir(parents=True)
    package_worker.unpack(wheel, staging / "new", lambda size: None)
    package_worker.move_in(package_worker.Wheel(name, version, (), 0, 0), staging, target)
    shutil.rmtree(staging)


def read_binaries(folder: Path, system: str) -> dict[str, Binary]:
    """All compiled files of a folder by their paths."""
    binaries = {}
    for path in sorted(distributions.measure_files(folder)):
        parts = PurePosixPath(path).name.split(".")
        if not set(MODULES[system] + LIBRARIES[system]) & {f".{part}" for part in parts[1:]}:
            continue
        try:
            entry = read_binary((folder / path).read_bytes())
        except (struct.error, ValueError, StopIteration):
            entry = Binary("damaged", (), ())
        if entry:
            binaries[path] = entry
    return binaries


def find_wrong_machines(files: dict[str, Binary], system: str, machine: str) -> list[str]:
    return [f"{path} is made for {file.system} {' '.join(file.machines)}" for path, file in files.items()
            if file.system != system or machine not in file.machines]


def find_missing_libraries(files: dict[str, Binary], system: str) -> list[str]:
    """"A needs B", of all that modules load and what these load in turn, by name."""
    provided = {PurePosixPath(path).name.lower(): path for path in files}
    waiting = [path for path in files if path.endswith(MODULES[system]) and not _is_library(path, system)]
    visited, missing = set(waiting), []
    while waiting:
        path = waiting.pop()
        for need in files[path].needs:
            name = PurePosixPath(need).name.lower()
            if name in provided:
                if provided[name] not in visited:
                    visited.add(provided[name])
                    waiting.append(provided[name])
            elif not (need if system == "macosx" else name).lower().startswith(PRESENT[system]):
                missing.append(f"{path} needs {need}")
    return sorted(missing)


def _is_library(path: str, system: str) -> bool:
    return system == "linux" and PurePosixPath(path).name.startswith("lib")


def find_too_long(paths: Iterable[str]) -> list[str]:
    """Paths that only programs reach which ask Windows for long ones, as our installer does."""
    return [path for path in paths if len(WINDOWS) + len(path) > LONGEST]


def check(platform: str, python: str, folder: Path, expected: dict[str, str]) -> dict:
    """A line of the report on a folder of wheels; "problems" is empty when all is well."""
    system, machine = MACHINES[platform]
    intact, files = distributions.find_intact(folder, by_content=True), read_binaries(folder, system)
    problems = [f"{name} {version} is not complete" for name, version in expected.items()
                if intact.get(name) != version]
    problems += find_wrong_machines(files, system, machine) + find_missing_libraries(files, system)
    sizes = distributions.measure_files(folder)
    imported = [path for path in find_too_long(sizes) if path.endswith((".py", *MODULES[system], *LIBRARIES[system]))]
    if platform.startswith("windows"):
        problems += [f"{path} is too long for Windows" for path in imported]
    return {"platform": platform, "python": python, "distributions": len(expected), "files": len(sizes),
            "bytes": sum(sizes.values()), "compiled": len(files), "longest_path": max(map(len, sizes), default=0),
            "too_long_on_windows": len(find_too_long(sizes)), "problems": problems}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.check_wheels", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="for downloads and installed packages")
    parser.add_argument("--platforms", type=lambda text: text.split(","), default=list(wheel_files.PLATFORMS))
    parser.add_argument("--pythons", type=lambda text: text.split(","), default=list(wheel_files.PYTHONS))
    parser.add_argument("--leave-out", default="-", metavar="PREFIX", help="of distributions, such as nvidia-")
    options = parser.parse_args()
    failed = 0
    for platform in options.platforms:
        for python in options.pythons:
            target, expected = options.folder / f"{platform}-{python}", {}
            shutil.rmtree(target, ignore_errors=True)
            for name, version, tag, pin in wheel_files.find_fitting(platform, python):
                if name.startswith(options.leave_out):
                    continue
                file = wheel_files.fetch_one(name, version, tag, pin["sha256"], options.folder / "wheels", python)
                install(file, name, version, target)
                expected[name] = version
            result = check(platform, python, target, expected)
            failed += bool(result["problems"])
            print(json.dumps(result), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
