# SPDX-License-Identifier: GPL-3.0-or-later
"""Downloads one wheel with pip; a part of package_worker.py: standard library and its neighbours only."""
from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import distributions
from hub_worker import Explained
from wheels import Wheel

KEPT = "packages that are complete are kept, the next installation downloads the others"  # pip resumes no file
INTERVAL = 0.5  # seconds between two looks at how much has arrived
KEPT_VARIABLES = {"PIP_CERT", "PIP_CLIENT_CERT", "PIP_PROXY"}  # how to get out of this network, not what to install
FROM_WHEEL = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('pip', run_name='__main__')"


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


def download(wheel: Wheel, staging: Path, tell_size: Callable[[int], None]) -> Path:
    """The wheel's file in `staging`, compared with its hashes by pip. Raises Explained, and what tell_size raises."""
    temporary, log, requirements = staging / "tmp", staging / "log", staging / "requirements.txt"
    temporary.mkdir()
    hashes = "".join(f" --hash=sha256:{value}" for value in wheel.sha256)
    requirements.write_text(f"{wheel.name}=={wheel.version}{hashes}\n")
    command = [*pip_command(), "download", "--no-input", "--disable-pip-version-check", "--progress-bar=off",
               "--no-cache-dir", "--no-deps", "--only-binary=:all:", "--dest", str(staging),
               "--requirement", str(requirements)]
    command += ["--require-hashes"] if hashes else []
    command += ["--index-url", wheel.index] if wheel.index else []
    with open(log, "wb") as output:
        pip = subprocess.Popen(command, env=environment(temporary), stdin=subprocess.DEVNULL, stdout=output,
                               stderr=subprocess.STDOUT, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        try:
            while pip.poll() is None:  # its output says nothing between the beginning and the end of a file
                tell_size(min(sum(distributions.measure_files(staging).values()), wheel.download))
                time.sleep(INTERVAL)
        finally:
            pip.kill()
            pip.wait()
    text = log.read_text(encoding="utf-8", errors="replace")
    found = list(staging.glob("*.whl"))
    if pip.returncode or not found:
        print(text, file=sys.stderr)
        raise Explained(reason(wheel, text))
    return found[0]


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
