# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on loaded from the source tree, for command lines that run beside it (an installed one is `bl_ext.*`)."""
from __future__ import annotations

import importlib.util
import os
import sys
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
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
