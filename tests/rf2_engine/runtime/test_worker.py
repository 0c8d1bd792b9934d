# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of viewports are made on one thread, which ends when it is told to and gives way to renders."""
import threading
import weakref

import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import running
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime.worker import Stopped, Worker

PATIENCE = 20  # seconds, of a machine that does much else


class Counting:
    """Work of some steps, each of which ends when it is told to."""

    def __init__(self, steps=1, asked=0.0, hold=None):
        self.left, self.requested_at, self.hold, self.threads = steps, asked, hold, []
        self.began, self.done, self.stopped = threading.Event(), threading.Event(), False

    def has_work(self):
        return self.left > 0

    def step(self, listen):
        self.threads.append(threading.current_thread())
        self.began.set()
        try:
            while self.hold and not self.hold.wait(0.01):
                listen()
        except Stopped:
            self.stopped = True
            return
        self.left -= 1
        if not self.left:
            self.done.set()


@pytest.fixture
def worker():
    made = Worker()
    yield made
    made.stop()


def test_all_steps_are_done_on_a_thread_that_is_not_blenders(worker):
    work = Counting(3)
    worker.add(work)
    worker.wake()
    assert work.done.wait(PATIENCE) and worker.wait_until_idle(PATIENCE)
    assert len(set(work.threads)) == 1 and work.threads[0] is not threading.main_thread()


def test_whoever_asked_last_comes_first(worker):
    order, first, last = [], Counting(1, 1.0), Counting(1, 2.0)
    for work in (first, last):
        work.step = lambda listen, work=work: (order.append(work), Counting.step(work, listen))
        worker.add(work)
    worker.wake()
    assert first.done.wait(PATIENCE) and order == [last, first]


def test_it_stops_in_the_middle_of_work_and_begins_again(worker):
    work = Counting(hold=threading.Event())
    worker.add(work)
    worker.wake()
    assert work.began.wait(PATIENCE)
    worker.stop()
    assert work.stopped and not work.threads[0].is_alive()
    work.hold.set()
    worker.add(work)
    worker.wake()
    assert work.done.wait(PATIENCE)


def test_a_render_ends_the_work_and_nothing_is_begun_during_it(worker, monkeypatch):
    work, is_rendering = Counting(hold=threading.Event()), threading.Event()
    worker.add(work)
    worker.wake()
    assert work.began.wait(PATIENCE)
    monkeypatch.setattr(running, "is_under_way", is_rendering.is_set)
    is_rendering.set()
    assert worker.wait_until_idle(PATIENCE) and work.stopped
    work.hold.set()
    worker.wake()
    assert not work.done.is_set()
    is_rendering.clear()
    worker.wake()
    assert work.done.wait(PATIENCE)


def test_work_that_nobody_holds_is_forgotten(worker):
    work = Counting()
    held = weakref.ref(work)
    worker.add(work)
    worker.wake()
    assert work.done.wait(PATIENCE) and worker.wait_until_idle(PATIENCE)
    del work
    assert held() is None and worker.works() == []
