# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs wheels into a folder with pip, in a process of its own: ending it, or Blender's end, ends pip and tidies up.

A program, not a module of the add-on: `python -I package_worker.py` reads a line of JSON from standard input,
    {"target": folder, "by_content": bool, "wheels": [{"name", "version", "sha256": [hash], "index": address or "",
     "download", "unpacked" (bytes)}]}
and writes one a line: {"total", "present" (bytes), "text"}, or at the end {"error"}. The end of standard input is the
order to stop.

Wheels that are complete in the target are left alone (by_content: their hashes are computed). Each other one is
installed into STAGING inside the target, checked, and moved to its place, its RECORD last: what is interrupted never
looks complete, and what was complete before is kept.
"""
from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import traceback
from importlib.util import find_spec
from pathlib import Path

sys.path.append(str(Path(__file__).parent))  # at the end: some of our names are other people's too

import distributions  # noqa: E402
from distributions import STAGING  # noqa: E402
from hub_worker import KEPT, Explained, lock, require_space, unusable  # noqa: E402
from wheels import Wheel, space_needed  # noqa: E402

INTERVAL = 0.5  # seconds between two looks at how much has arrived
KEPT_VARIABLES = {"PIP_CERT", "PIP_CLIENT_CERT", "PIP_PROXY"}  # how to get out of this network, not what to install
FROM_WHEEL = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('pip', run_name='__main__')"

stopped = threading.Event()


class Stopped(Exception):
    """Nobody wants the packages any more."""


def pip_command() -> list[str]:
    """Blender's pip, or the one that Python carries along to make one. Raises Explained without either."""
    if find_spec("pip"):
        return [sys.executable, "-I", "-m", "pip"]
    if spec := find_spec("ensurepip"):
        for wheel in sorted(Path(spec.origin).parent.glob("_bundled/pip-*.whl")):
            return [sys.executable, "-I", "-c", FROM_WHEEL, str(wheel)]
    raise Explained(f"Blender's Python has no pip: use Blender from blender.org, or install pip for {sys.executable}")


def environment(temporary: Path) -> dict[str, str]:
    """Without settings of pip and Python that are meant for others; proxies and certificates stay."""
    cleaned = {key: value for key, value in os.environ.items()
               if not key.startswith(("PIP_", "PYTHON")) or key in KEPT_VARIABLES}
    if "SSL_CERT_FILE" in cleaned:  # which older pips do not know
        cleaned.setdefault("REQUESTS_CA_BUNDLE", cleaned["SSL_CERT_FILE"])
    return cleaned | {"PIP_CONFIG_FILE": os.devnull} | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))


def install(request: dict, tell) -> None:
    """tell(**message) is called whenever something changed."""
    target = Path(request["target"])
    target.mkdir(parents=True, exist_ok=True)
    lock(target, f"another Blender is installing packages into {target}")
    staging = target / STAGING
    try:
        shutil.rmtree(staging, ignore_errors=True)  # of a process that could not tidy up
        if not request["wheels"]:
            return
        tell(total=0, present=0, text="Checking what is there")
        there = distributions.intact(target, request["by_content"])
        wheels = [wheel for wheel in (Wheel(**fields) for fields in request["wheels"])
                  if there.get(wheel.name) != wheel.version]
        total = sum(wheel.download + wheel.unpacked for wheel in wheels)
        require_space(target, space_needed(wheels))
        done = 0
        for number, wheel in enumerate(wheels, 1):
            text = f"{wheel.name} {wheel.version} ({number} of {len(wheels)})"
            staging.mkdir()
            install_wheel(wheel, staging, lambda size: tell(total=total, present=done + size, text=text))  # noqa: B023
            move_in(wheel, staging, target)
            shutil.rmtree(staging, ignore_errors=True)
            done += wheel.download + wheel.unpacked
        tell(total=total, present=total, text="")
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def install_wheel(wheel: Wheel, staging: Path, tell_size) -> None:
    """One wheel into staging/packages. Raises Explained, Stopped."""
    temporary, log = staging / "tmp", staging / "log"
    temporary.mkdir()
    hashes = "".join(f" --hash=sha256:{value}" for value in wheel.sha256)
    (staging / "requirements.txt").write_text(f"{wheel.name}=={wheel.version}{hashes}\n")
    command = [*pip_command(), "install", "--no-input", "--disable-pip-version-check", "--progress-bar=off",
               "--no-cache-dir", "--no-compile", "--no-deps", "--only-binary=:all:", "--no-warn-script-location",
               "--target", str(staging / "packages"), "--requirement", str(staging / "requirements.txt")]
    command += ["--require-hashes"] if hashes else []
    command += ["--index-url", wheel.index] if wheel.index else []
    with open(log, "wb") as output:
        pip = subprocess.Popen(command, env=environment(temporary), stdin=subprocess.DEVNULL, stdout=output,
                               stderr=subprocess.STDOUT, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        try:
            watch(pip, staging, wheel.download + wheel.unpacked, tell_size)
        finally:
            pip.kill()
            pip.wait()
    if pip.returncode:
        text = log.read_text(encoding="utf-8", errors="replace")
        print(text, file=sys.stderr)
        raise Explained(reason(wheel, text))


def watch(pip: subprocess.Popen, staging: Path, expected: int, tell_size) -> None:
    """Until pip ends. Its output says nothing between the beginning and the end of a file: the folder's growth does."""
    last = -1
    while pip.poll() is None:
        size = min(sum(distributions.sizes(staging).values()), expected)
        if size != last:
            last = size
            tell_size(size)
        if stopped.wait(INTERVAL):
            raise Stopped


def reason(wheel: Wheel, log: str) -> str:
    """pip's output in one line for the user."""
    what = f"{wheel.name} {wheel.version}"
    if "DO NOT MATCH THE HASHES" in log:
        return f"{what}: the file that was sent is not the one that this add-on knows, so it was not installed"
    if "No space left" in log or "Errno 28" in log:
        return f"{what}: the disk is full ({KEPT})"
    errors = [line.removeprefix("ERROR: ") for line in log.splitlines() if line.startswith("ERROR: ")]
    last = (errors or log.splitlines() or [""])[-1]
    return f"{what} could not be installed: {last[:300]} (check the connection; {KEPT})"


def move_in(wheel: Wheel, staging: Path, target: Path) -> None:
    """From staging to the target, in place of an older or damaged one. Raises Explained when pip did not finish."""
    made, name = staging / "packages", wheel.name
    if distributions.intact(made).get(name) != wheel.version:
        raise Explained(f"{name} {wheel.version} arrived incomplete: install again")
    (info,) = distributions.infos(made)[name]
    remove(name, target, staging / "old")
    listed = [entry.path for entry in distributions.entries(info)]
    for path in sorted(listed, key=lambda path: path.endswith(".dist-info/RECORD")):
        (target / path).parent.mkdir(parents=True, exist_ok=True)
        (made / path).replace(target / path)


def remove(name: str, target: Path, to: Path) -> None:
    """Move a distribution's own files away: Windows lets what a running Blender has loaded be moved, not deleted."""
    to.mkdir()
    infos = distributions.infos(target)
    others = {entry.path for other, found in infos.items() if other != name
              for info in found for entry in distributions.entries(info)}
    for info in infos.get(name, ()):
        for number, entry in enumerate(distributions.entries(info)):
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
        tell(error=str(unusable(request["target"], error)))
        return 1
    except Exception as error:
        traceback.print_exc()
        tell(error=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
