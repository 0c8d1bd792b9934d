# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on loaded from the source tree, for command lines that run beside it (an installed one is `bl_ext.*`)."""
from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import NoReturn

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "renderformer_v2"


def load() -> ModuleType:
    """The package `renderformer_v2`, so that `from renderformer_v2.rf2_engine import ...` works; not registered."""
    if PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(PACKAGE, ROOT / "__init__.py",
                                                      submodule_search_locations=[str(ROOT)])
        sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[PACKAGE])
    return sys.modules[PACKAGE]


def leave(code: int) -> NoReturn:
    """End the process at once: the exit handlers of the bpy module can hang after a RenderEngine was registered."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:  # the reader is gone
        code = code or 1
    finally:
        _remove_temporary_folder()
        os._exit(code)


def _remove_temporary_folder() -> None:
    """Blender's, which it makes for each process and removes in its exit handlers."""
    if bpy := sys.modules.get("bpy"):
        with suppress(OSError, AttributeError):  # where files are in it, it is not removed
            os.rmdir(bpy.app.tempdir)


def run(main: Callable[[], int]) -> NoReturn:
    """End the process with the status of `main`, or with 1 and a traceback when it raises."""
    try:
        status = main()
    except SystemExit:  # of the argument parser; nothing of Blender is registered yet
        raise
    except BaseException:  # an interruption too: with Blender loaded, Python would not end by itself
        traceback.print_exc()
        status = 1
    leave(status)
