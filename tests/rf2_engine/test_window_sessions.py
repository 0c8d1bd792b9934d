# SPDX-License-Identifier: GPL-3.0-or-later
"""The scripts of tests/window, which a test run without a window does not run, import what there is."""
import ast
import importlib
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[1] / "window").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_every_name_that_a_session_imports_from_the_add_on_exists(script):
    imports = [node for node in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
               if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("bl_ext.")]
    for node in imports:
        module = importlib.import_module(node.module)
        for alias in node.names:
            assert hasattr(module, alias.name) or importlib.import_module(f"{node.module}.{alias.name}")
