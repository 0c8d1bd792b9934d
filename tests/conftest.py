# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps the tests away from the user's Blender settings, and ends the process although bpy would not.

Tests that need Blender live under tests/rf2_engine and tests/tools; whatever imports bpy first sees these folders.
With `-n auto` every worker is a process with a Blender, folders and a built extension of its own.
"""
import os
import sys
import tempfile

import tools  # noqa: F401  makes the package `renderformer_v2` importable

sys.modules.setdefault("triton", None)  # its LLVM crashes beside that of a graphics driver, which compositing loads
WORKER_MEMORY = 3 << 30  # bytes for one worker and the programs that its tests start

_user = tempfile.TemporaryDirectory(prefix="renderformer-v2-tests-")
for _kind in ("RESOURCES", "CONFIG", "SCRIPTS", "EXTENSIONS", "DATAFILES"):
    os.environ[f"BLENDER_USER_{_kind}"] = os.path.join(_user.name, _kind.lower())
    os.makedirs(os.environ[f"BLENDER_USER_{_kind}"])

_exit_status = 0


def pytest_xdist_auto_num_workers(config):
    """As many as there are cores and memory for, each with its share of the cores."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 16 << 30
    workers = max(1, min(cores, memory // WORKER_MEMORY))
    os.environ.setdefault("OMP_NUM_THREADS", str(cores // workers))
    return workers


def pytest_sessionfinish(session, exitstatus):
    global _exit_status
    _exit_status = int(exitstatus)


def pytest_unconfigure(config):
    if "bpy" in sys.modules:  # its exit handlers can hang after a RenderEngine was registered
        _user.cleanup()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_exit_status)
