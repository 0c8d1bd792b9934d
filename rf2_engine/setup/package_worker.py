# SPDX-License-Identifier: GPL-3.0-or-later
"""Install wheels that pip downloads, in a process of its own: its end, or that of Blender, ends pip and tidies up.

A program, not a module of the add-on: `python -I package_worker.py` reads a line of JSON from standard input,
    {"target": folder, "by_content": bool, "wheels": [{"name", "version", "sha256": [hash], "index": address or "",
     "download", "unpacked" (bytes)}]}
and writes lines of JSON: {"total", "present" (bytes), "text"}, or at the end {"error"}. The end of standard input
is the order to stop.

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

sys.path.append(str(Path(__file__).parent))  # at the end, because other packages have some of our names

import distributions  # noqa: E402
from distributions import STAGING  # noqa: E402
from hub_worker import ExplainedError, explain_disk, lock, require_space  # noqa: E402
from pip_download import INTERVAL, REPEATABLE, download  # noqa: E402
from wheels import Wheel, space_needed  # noqa: E402

stopped = threading.Event()


class Stopped(Exception):
    """Blender does not want the packages any more."""


def install(request: dict, send) -> None:
    """Install what is requested; send(**message) is called whenever something changes."""
    target = distributions.allow_long_paths(Path(request["target"]))
    target.mkdir(parents=True, exist_ok=True)
    lock(target, f"another Blender is installing packages into {request['target']}")
    staging = target / STAGING
    try:
        shutil.rmtree(staging, ignore_errors=True)  # left by a killed process
        if not request["wheels"]:
            return
        send(total=0, present=0, text="Checking installed files")
        intact = distributions.find_intact(target, request["by_content"])
        wheels = [wheel for wheel in (Wheel(**fields) for fields in request["wheels"])
                  if intact.get(wheel.name) != wheel.version]
        total = sum(wheel.download + wheel.unpacked for wheel in wheels)
        require_space(target, space_needed(wheels))
        done = last = 0

        def report(text: str, start: int, size: int) -> None:
            nonlocal last
            if stopped.is_set():
                raise Stopped
            if start + size != last:
                last = start + size
                send(total=total, present=min(last, total), text=text)

        for number, wheel in enumerate(wheels, 1):
            text = f"{wheel.name} {wheel.version} ({number} of {len(wheels)})"
            staging.mkdir()
            file = download(wheel, Path(request["target"]) / STAGING, partial(report, text, done))
            unpack(file, staging / "new", partial(report, text, done + wheel.download))
            move_in(wheel, staging, target)
            shutil.rmtree(staging, ignore_errors=True)
            done += wheel.download + wheel.unpacked
        send(total=total, present=total, text="")
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def unpack(file: Path, to: Path, report_size) -> None:
    """Unpack a wheel without its programs and manuals. pip would, but with paths too long for Windows."""
    size, last = 0, time.monotonic()
    with ZipFile(file) as archive:
        for entry in archive.infolist():
            if distributions.is_data(entry.filename):
                continue
            path = Path(archive.extract(entry, to))
            if entry.external_attr >> 16 & 0o111 and path.is_file():
                path.chmod(0o755)
            size += entry.file_size
            if time.monotonic() - last > INTERVAL:
                last = time.monotonic()
                report_size(size)


def move_in(wheel: Wheel, staging: Path, target: Path) -> None:
    """Move a wheel from staging to the target, over an older or damaged one. Raises ExplainedError if incomplete."""
    unpacked, name = staging / "new", wheel.name
    if distributions.find_intact(unpacked).get(name) != wheel.version:
        raise ExplainedError(f"{name} {wheel.version} arrived incomplete: install again")
    (info,) = distributions.find_infos(unpacked)[name]
    remove(name, target, staging / "old")
    paths = [entry.path for entry in distributions.read_entries(info)]
    for path in sorted(paths, key=lambda path: path.endswith(".dist-info/RECORD")):
        (target / path).parent.mkdir(parents=True, exist_ok=True)
        (unpacked / path).replace(target / path)


def remove(name: str, target: Path, to: Path) -> None:
    """Move a distribution's own files away: Windows lets files that Blender has loaded be moved, not deleted."""
    to.mkdir()
    infos = distributions.find_infos(target)
    others = {entry.path for other, folders in infos.items() if other != name
              for info in folders for entry in distributions.read_entries(info)}
    for info in infos.get(name, ()):
        for number, entry in enumerate(distributions.read_entries(info)):
            if entry.path not in others and (target / entry.path).is_file():
                (target / entry.path).replace(to / f"{info.name}.{number}")
        shutil.rmtree(info, ignore_errors=True)


def wait_for_stop() -> None:
    while os.read(0, 1024):  # sys.stdin has a lock that no thread may hold when Python ends
        pass
    stopped.set()


def main() -> int:
    request = json.loads(sys.stdin.readline())
    channel, sys.stdout = sys.stdout, sys.stderr
    threading.Thread(target=wait_for_stop, daemon=True).start()

    def send(**message) -> None:
        print(json.dumps(message), file=channel, flush=True)

    try:
        install(request, send)
    except (Stopped, BrokenPipeError):
        return 2
    except ExplainedError as error:
        send(error=str(error))
        return 1
    except OSError as error:
        traceback.print_exc()
        send(error=str(explain_disk(request["target"], error, REPEATABLE)))
        return 1
    except Exception as error:
        traceback.print_exc()
        send(error=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
