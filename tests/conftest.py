# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps the tests away from the user's Blender settings, and ends the process although bpy would not.

Tests that need Blender live under tests/rf2_engine and tests/tools; whatever imports bpy first sees these folders.
"""
import os
import sys
import tempfile

import tools  # noqa: F401  makes the package `renderformer_v2` importable

_user = tempfile.TemporaryDirectory(prefix="renderformer-v2-tests-")
for _kind in ("RESOURCES", "CONFIG", "SCRIPTS", "EXTENSIONS", "DATAFILES"):
    os.environ[f"BLENDER_USER_{_kind}"] = os.path.join(_user.name, _kind.lower())
    os.makedirs(os.environ[f"BLENDER_USER_{_kind}"])

_exit_status = 0


def pytest_sessionfinish(session, exitstatus):
    global _exit_status
    _exit_status = int(exitstatus)


def pytest_unconfigure(config):
    if "bpy" in sys.modules:  # its exit handlers can hang after a RenderEngine was registered
        _user.cleanup()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_exit_status)
