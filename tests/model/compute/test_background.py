# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports on a thread can be waited for, given up and taken up again."""
import subprocess
import sys
from threading import Event

import pytest

from renderformer_v2.model import progress
from renderformer_v2.model.compute import threads
from renderformer_v2.model.errors import RenderCancelled


def test_giving_up_ends_the_wait_and_not_the_import():
    done = Event()
    future = threads.begin_import(lambda: done.wait(60))

    def cancel(text, fraction):
        raise RenderCancelled()
    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        threads.finish_import(future)
    assert not future.done()
    done.set()
    assert threads.finish_import(future) is True


def test_errors_come_out_where_the_import_is_needed():
    future = threads.begin_import(lambda: __import__("a_module_that_is_not_there"))
    with pytest.raises(ModuleNotFoundError, match="a_module_that_is_not_there"):
        threads.finish_import(future)


def test_loading_the_bundled_network_leaves_slow_imports_out():
    """PyTorch's compiler and what it needs take longer to import than the network takes to load."""
    code = ("import sys, tools; from renderformer_v2.model.renderer import Renderer; Renderer(device='cpu'); "
            "print({'torch._dynamo', 'sympy', 'diffusers'} & set(sys.modules))")
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "set()"
