# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs wheels that pip downloads, in a process of its own: ending it, or Blender's end, ends pip and tidies up.

A program, not a module of the add-on: `python -I package_worker.py` reads a line of JSON from standard input,
    {"target": folder, "by_content": bool, "wheels": [{"name", "version", "sha256": [hash], "index": address or "",
     "download", "unpacked" (bytes)}]}
and writes one a line: {"total", "present" (bytes), "text"}, or at the end {"error"}. The end of standard input is the
order to stop.

Wheels that are complete in the target are left alone (by_content: their hashes are computed). Each other one is
downloaded by pip into STAGING inside the target, unpacked there, checked, and moved to its place, its RECORD last: what
is interrupted never looks complete, and what was complete before is kept.
"""
from __future__ import annotations

import json
import os
import shutil
import sys
import threading
import time
import traceback
from functools import partial
from pathlib import Path
from zipfile import ZipFile

sys.path.append(str(Path(__file__).parent))  # at the end: some of our names are other people's too

import distributions  # noqa: E402
from distributions import STAGING  # noqa: E402
from hub_worker import Explained, lock, require_space, unusable  # noqa: E402
from pip_download import INTERVAL, KEPT, download  # noqa: E402
from wheels import Wheel, space_needed  # noqa: E402

stopped = threading.Event()


class Stopped(Exception):
    """Nobody wants the packages any more."""


def install(request: dict, tell) -> None:
    """tell(**message) is called whenever something changed."""
    target = distributions.allow_long_paths(Path(request["target"]))
    target.mkdir(parents=True, exist_ok=True)
    lock(target, f"another Blender is installing packages into {request['target']}")
    staging = target / STAGING
    try:
        shutil.rmtree(staging, ignore_errors=True)  # of a process that could not tidy up
        if not request["wheels"]:
            return
        tell(total=0, present=0, text="Checking installed files")
        there = distributions.find_intact(target, request["by_content"])
        wheels = [wheel for wheel in (Wheel(**fields) for fields in request["wheels"])
                  if there.get(wheel.name) != wheel.version]
        total = sum(wheel.download + wheel.unpacked for wheel in wheels)
        require_space(target, space_needed(wheels))
        done = last = 0

        def at(text: str, start: int, size: int) -> None:
            nonlocal last
            if stopped.is_set():
                raise Stopped
            if start + size != last:
                last = start + size
                tell(total=total, present=min(last, total), text=text)

        for number, wheel in enumerate(wheels, 1):
            text = f"{wheel.name} {wheel.version} ({number} of {len(wheels)})"
            staging.mkdir()
            file = download(wheel, Path(request["target"]) / STAGING, partial(at, text, done))
            unpack(file, staging / "new", partial(at, text, done + wheel.download))
            move_in(wheel, staging, target)
            shutil.rmtree(staging, ignore_errors=True)
            done += wheel.download + wheel.unpacked
        tell(total=total, present=total, text="")
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def unpack(file: Path, to: Path, tell_size) -> None:
    """Without NAME.data: programs and manuals. pip would do the same, but in paths too long for Windows."""
    size, told = 0, time.monotonic()
    with ZipFile(file) as archive:
        for entry in archive.infolist():
            if distributions.is_data(entry.filename):
                continue
            path = Path(archive.extract(entry, to))
            if entry.external_attr >> 16 & 0o111 and path.is_file():
                path.chmod(0o755)
            size += entry.file_size
            if time.monotonic() - told > INTERVAL:
                told = time.monotonic()
                tell_size(size)


def move_in(wheel: Wheel, staging: Path, target: Path) -> None:
    """From staging to the target, in place of an older or damaged one. Raises Explained when something is missing."""
    made, name = staging / "new", wheel.name
    if distributions.find_intact(made).get(name) != wheel.version:
        raise Explained(f"{name} {wheel.version} arrived incomplete: install again")
    (info,) = distributions.find_infos(made)[name]
    remove(name, target, staging / "old")
    listed = [entry.path for entry in distributions.read_entries(info)]
    for path in sorted(listed, key=lambda path: path.endswith(".dist-info/RECORD")):
        (target / path).parent.mkdir(parents=True, exist_ok=True)
        (made / path).replace(target / path)


def remove(name: str, target: Path, to: Path) -> None:
    """Move a distribution's own files away: Windows lets what a running Blender has loaded be moved, not deleted."""
    to.mkdir()
    infos = distributions.find_infos(target)
    others = {entry.path for other, found in infos.items() if other != name
              for info in found for entry in distributions.read_entries(info)}
    for info in infos.get(name, ()):
        for number, entry in enumerate(distributions.read_entries(info)):
            if entry.path not in others and (target / entry.path).is_file():
                (target / entry.path).replace(to / f"{info.name}.{number}")
        shutil.rmtree(info, ignore_errors=True)


def wait_for_stop() -> None:
    while os.read(0, 1024):  # not sys.stdin, whose lock a thread must not hold when Python ends
        pass
    stopped.set()


def main() -> int:
    request = json.loads(sys.stdin.readline())
    channel, sys.stdout = sys.stdout, sys.stderr
    threading.Thread(target=wait_for_stop, daemon=True).start()

    def tell(**message) -> None:
        print(json.dumps(message), file=channel, flush=True)

    try:
        install(request, tell)
    except (Stopped, BrokenPipeError):
        return 2
    except Explained as error:
        tell(error=str(error))
        return 1
    except OSError as error:
        traceback.print_exc()
        tell(error=str(unusable(request["target"], error, KEPT)))
        return 1
    except Exception as error:
        traceback.print_exc()
        tell(error=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
