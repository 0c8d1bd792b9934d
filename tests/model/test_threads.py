# SPDX-License-Identifier: GPL-3.0-or-later
"""How many threads compute, and that they sleep while they wait: each case in a process that loads PyTorch anew."""
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
POLICY = ("OMP_WAIT_POLICY", "KMP_BLOCKTIME", "GOMP_SPINCOUNT")
# A part that all threads share, then one for this thread alone, in which the others wait: how much the others used.
WAITING = """
import sys, time
before = "torch" in sys.argv
if before:
    import torch
import tools
import torch
from renderformer_v2.model.threads import team
shared, alone = torch.ones(1 << 22), torch.ones(1 << 10)

def others():
    used = 0.0
    for _ in range(20):
        shared.add_(1)
        begin, own = time.process_time(), time.thread_time()
        while time.thread_time() - own < 2e-3:
            alone.add_(1)
        used += time.process_time() - begin - (time.thread_time() - own)
    return used / (20 * 2e-3)

torch.set_num_threads(2)
with team():
    print(others())
"""


def run(program: str, *arguments, **environment) -> list[str]:
    """What the program printed, in an environment that says nothing of how threads wait but for `environment`."""
    clean = {name: value for name, value in os.environ.items() if name not in POLICY}
    done = subprocess.run([sys.executable, "-c", program, *arguments], env=clean | environment, cwd=ROOT,
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("arguments", [
    [], pytest.param(["torch"], marks=pytest.mark.skipif(not sys.platform.startswith("linux"),
                                                         reason="only GNU's library is told so late"))],
    ids=["PyTorch is imported later", "PyTorch was there before"])
def test_threads_of_a_team_sleep_while_they_wait(arguments):
    """Spinning threads use as much as the one that works, unless other programs take it from them."""
    (used,) = run(WAITING, *arguments)
    assert float(used) < 0.2


CHOSEN = """
import os, threading
import tools
from renderformer_v2.model.threads import team
with team():
    print(threading.active_count(), *(os.environ.get(name) for name in ("OMP_WAIT_POLICY", "KMP_BLOCKTIME")))
"""


def test_how_threads_wait_is_left_to_a_user_who_says_it():
    assert run(CHOSEN, OMP_WAIT_POLICY="ACTIVE") == ["1", "ACTIVE", "None"]
    assert run(CHOSEN)[1:] == ["PASSIVE", "0"]


COUNT = """
import tools, torch
from renderformer_v2.model.threads import team
before = torch.get_num_threads()
with team(3):
    inside = torch.get_num_threads()
try:
    with team(1):
        raise ValueError
except ValueError:
    pass
print(inside, torch.get_num_threads() == before)
"""


def test_the_number_of_threads_holds_inside_and_is_put_back():
    assert run(COUNT) == ["3", "True"]
