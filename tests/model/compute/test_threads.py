# SPDX-License-Identifier: GPL-3.0-or-later
"""How PyTorch's threads wait, rows that are shared between threads, and imports on a thread of their own."""
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest
import torch

from renderformer_v2.model import progress
from renderformer_v2.model.compute import threads
from renderformer_v2.model.compute.inference import Pieces, current_pieces, inference
from renderformer_v2.model.compute.threads import shared, team
from renderformer_v2.model.errors import RenderCancelled

ROOT = Path(__file__).parents[3]
POLICY = ("OMP_WAIT_POLICY", "KMP_BLOCKTIME", "GOMP_SPINCOUNT")
# A part that all threads share, then one for this thread alone, in which the others wait: how often the others slept.
WAITING = """
import sys, threading, time
from pathlib import Path
before = "torch" in sys.argv
if before:
    import torch
import tools
import torch
from renderformer_v2.model.compute.threads import team
shared, alone = torch.ones(1 << 22), torch.ones(1 << 10)

def sleeps():
    others = [task for task in Path("/proc/self/task").iterdir() if task.name != str(threading.get_native_id())]
    return sum(int((task / "status").read_text().split("voluntary_ctxt_switches:")[1].split()[0]) for task in others)

torch.set_num_threads(2)
with team():
    shared.add_(1)
    before = sleeps()
    for _ in range(20):
        shared.add_(1)
        begin = time.thread_time()
        while time.thread_time() - begin < 2e-3:
            alone.add_(1)
    print(sleeps() - before)
"""


def run(program: str, *arguments, **environment) -> list[str]:
    """What the program printed, in an environment that says nothing of how threads wait but for `environment`."""
    clean = {name: value for name, value in os.environ.items() if name not in POLICY}
    done = subprocess.run([sys.executable, "-c", program, *arguments], env=clean | environment, cwd=ROOT,
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux counts how often a thread sleeps")
@pytest.mark.parametrize("arguments", [[], ["torch"]], ids=["PyTorch is imported later", "PyTorch was there before"])
def test_threads_of_a_team_sleep_while_they_wait(arguments):
    """The other thread sleeps in each of 20 waits; a spinning one sees the next work before it would."""
    (sleeps,) = run(WAITING, *arguments)
    assert int(sleeps) > 10


CHOSEN = """
import os, threading
import tools
from renderformer_v2.model.compute.threads import team
with team():
    print(threading.active_count(), *(os.environ.get(name) for name in ("OMP_WAIT_POLICY", "KMP_BLOCKTIME")))
"""


def test_how_threads_wait_is_left_to_a_user_who_says_it():
    assert run(CHOSEN, OMP_WAIT_POLICY="ACTIVE") == ["1", "ACTIVE", "None"]
    assert run(CHOSEN)[1:] == ["PASSIVE", "0"]


COUNT = """
import tools, torch
from renderformer_v2.model.compute.threads import team
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
    with team(2), inference():
        yield


def test_shared_rows_come_back_in_order_and_the_team_is_as_before(two_threads):
    met, said = threading.Barrier(2, timeout=10), []

    def product(a, b):
        met.wait()  # both at the same time
        return a * b, torch.get_num_threads(), torch.is_grad_enabled()

    with progress.reporting(lambda text, fraction: said.append(fraction)):
        done = shared(product, torch.arange(6.0).split(1), torch.full((6,), 2.0).split(1))
    assert [(value.item(), *rest) for value, *rest in done] == [(2.0 * i, 1, False) for i in range(6)]
    assert said[0] == 0 and said == sorted(said) and said[-1] < 1
    assert torch.get_num_threads() == 2
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(torch.get_num_threads).result() == 2


def test_gradients_pass_through_rows_that_are_then_not_shared():
    x = torch.ones(4, requires_grad=True)
    with team(2):
        torch.cat(shared(lambda row: row * row, x.split(1))).sum().backward()
    assert x.grad.tolist() == [2.0] * 4


def test_rows_in_turn_go_on_from_what_they_reported_themselves():
    said = []
    with team(1), inference(), progress.reporting(lambda text, fraction: said.append(fraction)):
        shared(lambda row: progress.report(0.5), torch.zeros(4).split(1))
    assert said == pytest.approx([i / 8 for i in range(8)])


def test_every_thread_that_shares_rows_works_in_the_same_pieces(two_threads):
    met, pieces = threading.Barrier(2, timeout=10), Pieces()
    with inference(pieces):
        assert shared(lambda row: met.wait() >= 0 and current_pieces(), torch.zeros(2).split(1)) == [pieces] * 2


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


def test_work_without_pytorch_is_spread_over_as_many_threads_as_there_may_be():
    def name(row: int) -> tuple[int, str]:
        done.wait(timeout=5)  # so that no thread takes two rows
        return row, threading.current_thread().name

    for most in (1, 3):
        done = threading.Barrier(most)
        with threads.limited(most):
            rows, names = zip(*threads.spread(name, [(i,) for i in range(3)]), strict=True)
        assert rows == (0, 1, 2) and len(set(names)) == most


def test_a_team_is_no_larger_where_its_rows_share_rows_of_their_own():
    """The thread that has done its row helps with those of the other's."""
    at_work, lock, most, names = set(), threading.Lock(), [], []

    def inner(i: int) -> None:
        with lock:
            at_work.add(threading.get_ident())
            most.append(len(at_work))
        time.sleep(0.05)
        with lock:
            at_work.discard(threading.get_ident())
            names.append(threading.get_ident())

    def outer(count: int) -> None:
        threads.spread(inner, [(i,) for i in range(count)])

    with threads.limited(2):
        threads.spread(outer, [(12,), (2,)])
    assert max(most) == 2
    assert len(names) == 14 and max(names.count(name) for name in names) < 12


def test_esc_stops_the_work_of_all_threads_at_their_next_report(two_threads):
    def rows(row) -> None:
        for _ in range(200):
            progress.report()
            time.sleep(0.01)

    begin = time.perf_counter()
    with pytest.raises(RenderCancelled), progress.reporting(escape_after(0.1)):
        shared(rows, torch.arange(4).split(1))
    assert time.perf_counter() - begin < 1.5  # a row takes 2 s


def escape_after(seconds: float):
    end = time.perf_counter() + seconds

    def listen(text: str, fraction: float) -> None:
        if time.perf_counter() > end:
            raise RenderCancelled
    return listen


def test_giving_up_ends_the_wait_and_not_the_import():
    done = Event()
    future = threads.begin_import(lambda: done.wait(60))

    def cancel(text, fraction):
        raise RenderCancelled()
    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        threads.finish(future)
    assert not future.done()
    done.set()
    assert threads.finish(future) is True


def test_errors_come_out_where_the_import_is_needed():
    future = threads.begin_import(lambda: __import__("a_module_that_is_not_there"))
    with pytest.raises(ModuleNotFoundError, match="a_module_that_is_not_there"):
        threads.finish(future)


def test_loading_the_bundled_network_leaves_slow_imports_out():
    """PyTorch's compiler and what it needs take longer to import than the network takes to load."""
    code = ("import sys, tools; from renderformer_v2.model.renderer import Renderer; Renderer(device='cpu'); "
            "print({'torch._dynamo', 'sympy', 'diffusers'} & set(sys.modules))")
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "set()"
