# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated smoke against Cycles."""
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_simulated_smoke_is_as_dense_as_in_cycles():
    program = Path(__file__).with_name("gas_simulation.py")
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", program], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:]
