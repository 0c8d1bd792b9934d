# SPDX-License-Identifier: GPL-3.0-or-later
"""Download a wheel with pip; a part of package_worker.py, which has the standard library and its neighbours only."""
from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import distributions
from hub_worker import ExplainedError
from wheels import Wheel

# pip cannot resume a file.
REPEATABLE = "packages that are complete are kept, the next installation downloads the others"
REFUSED_CERTIFICATE = ("CERTIFICATE_VERIFY_FAILED", "confirming the ssl certificate")  # before pip finds "no version"
INTERVAL = 0.5  # seconds between two reports of progress
PASSED_VARIABLES = {"PIP_CERT", "PIP_CLIENT_CERT", "PIP_PROXY"}  # they describe the network, not what to install
FROM_WHEEL = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('pip', run_name='__main__')"


def pip_command() -> list[str]:
    """The command of Blender's pip, or of the one inside ensurepip. Raises ExplainedError without either."""
    if find_spec("pip"):
        return [sys.executable, "-I", "-m", "pip"]
    if spec := find_spec("ensurepip"):
        for wheel in sorted(Path(spec.origin).parent.glob("_bundled/pip-*.whl")):
            return [sys.executable, "-I", "-c", FROM_WHEEL, str(wheel)]
    raise ExplainedError("Blender's Python has no pip: use Blender from blender.org, or install pip for "
                         f"{sys.executable}")


def environment(temporary: Path) -> dict[str, str]:
    """Environment variables without the user's settings of pip and Python, but with proxies and certificates."""
    cleaned = {key: value for key, value in os.environ.items()
               if not key.startswith(("PIP_", "PYTHON")) or key in PASSED_VARIABLES}
    if "SSL_CERT_FILE" in cleaned:  # unknown to older versions of pip
        cleaned.setdefault("REQUESTS_CA_BUNDLE", cleaned["SSL_CERT_FILE"])
    return cleaned | {"PIP_CONFIG_FILE": os.devnull} | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))


def download(wheel: Wheel, staging: Path, report_size: Callable[[int], None]) -> Path:
    """The wheel's file in `staging`, whose hash pip has checked. Raises ExplainedError, and what report_size raises."""
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
            while pip.poll() is None:  # it prints nothing while it downloads a file
                report_size(min(sum(distributions.measure_files(staging).values()), wheel.download))
                time.sleep(INTERVAL)
        finally:
            pip.kill()
            pip.wait()
    text = log.read_text(encoding="utf-8", errors="replace")
    files = list(staging.glob("*.whl"))
    if pip.returncode or not files:
        print(text, file=sys.stderr)
        raise ExplainedError(explain_failure(wheel, text))
    return files[0]


def explain_failure(wheel: Wheel, log: str) -> str:
    """pip's output in one line for the user."""
    what = f"{wheel.name} {wheel.version}"
    if "DO NOT MATCH THE HASHES" in log:
        return f"{what}: the file that was sent is not the one that this add-on knows, so it was not installed"
    if "No space left" in log or "Errno 28" in log:
        return f"{what}: the disk is full ({REPEATABLE})"
    if any(words in log for words in REFUSED_CERTIFICATE):
        return (f"{what}: the package index answered with a certificate that this computer does not trust, as behind "
                "the proxy of a company. Ask its administrators for their certificate, set the environment variable "
                f"PIP_CERT to that file (.pem), and start Blender again. Otherwise check the computer's date "
                f"({REPEATABLE})")
    errors = [line.removeprefix("ERROR: ") for line in log.splitlines() if line.startswith("ERROR: ")]
    last = (errors or log.splitlines() or [""])[-1]
    return f"{what} could not be installed: {last[:300]} (check the connection; {REPEATABLE})"
