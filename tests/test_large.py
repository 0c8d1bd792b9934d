# SPDX-License-Identifier: GPL-3.0-or-later
"""Large scenes and large pictures: what is made of them, and how much memory that takes at most."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems count memory in other units")


def said(kind: str) -> dict:
    done = subprocess.run([sys.executable, "-m", "tests.large_program", kind], cwd=ROOT, capture_output=True, text=True,
                          timeout=1800)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@needs_linux
def test_a_million_triangles_become_as_many_as_the_network_takes():
    found = said("million_triangles")
    assert found["before"] == 999_698 and 3000 < found["after"] <= 4096
    assert found["area"] == pytest.approx(1, abs=0.03)
    assert found["low"] == pytest.approx([-3, -3, -0.2], abs=0.02)
    assert found["high"] == pytest.approx([3, 3, 0.2], abs=0.02)
    assert found["memory"] < 1e9


@pytest.mark.slow
@needs_linux
def test_a_picture_of_4096_by_2160_pixels_is_as_a_small_one_and_takes_less_than_7_gigabytes():
    found = said("large_picture")
    assert found["shape"] == [2160, 4096, 3] and found["finite"]
    assert found["off"] < 0.02 * found["mean"]
    assert found["memory"] < 7e9
