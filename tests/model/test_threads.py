# SPDX-License-Identifier: GPL-3.0-or-later
"""How many threads compute and what they share; and that they sleep while they wait, in processes that load PyTorch."""
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch

from renderformer_v2.model import progress
from renderformer_v2.model.errors import RenderCancelled
from renderformer_v2.model.threads import shared, team

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


@pytest.fixture
def two_threads():
    with team(2), torch.no_grad():
        yield


def test_shared_rows_come_back_in_order_and_the_team_is_as_before(two_threads):
    met, said = threading.Barrier(2, timeout=10), []

    def product(a, b):
        met.wait()  # both at the same time
        return a * b, torch.get_num_threads(), torch.is_grad_enabled()

    with progress.reporting(lambda text, fraction: said.append(fraction)):
        done = shared(product, torch.arange(6.0).split(1), torch.full((6,), 2.0).split(1))
    assert [(value.item(), *rest) for value, *rest in done] == [(2.0 * i, 1, False) for i in range(6)]
    assert said == pytest.approx([i / 6 for i in range(6)])
    assert torch.get_num_threads() == 2
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(torch.get_num_threads).result() == 2


def test_gradients_pass_through_rows_that_are_then_not_shared():
    x = torch.ones(4, requires_grad=True)
    with team(2), torch.enable_grad():
        torch.cat(shared(lambda row: row * row, x.split(1))).sum().backward()
    assert x.grad.tolist() == [2.0] * 4


def test_esc_ends_the_rows_that_have_not_begun(two_threads):
    begun = []

    def escape(text, fraction):
        if fraction:
            raise RenderCancelled

    def slow(row):
        begun.append(row)
        time.sleep(0.05)

    with pytest.raises(RenderCancelled), progress.reporting(escape):
        shared(slow, torch.arange(100).split(1))
    assert len(begun) < 10


def test_what_a_shared_row_raises_comes_out(two_threads):
    with pytest.raises(ZeroDivisionError):
        shared(lambda row: 1 / int(row), torch.arange(3).split(1))
