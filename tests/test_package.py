# SPDX-License-Identifier: GPL-3.0-or-later
"""In one process every class of the add-on exists once: its package is `renderformer_v2`, never a second `model`."""
import ast
import subprocess
import sys

from tests.sources import ROOT, python_files

IMPORT_ALL = """
import importlib, os, pkgutil, sys, tools
for module in pkgutil.walk_packages(tools.__path__, "tools."):
    importlib.import_module(module.name)
    print(module.name)
print(*sorted({"model", "rf2_engine", "renderformer_v2"} & set(sys.modules)))
sys.stdout.flush()
os._exit(0)  # the exit handlers of the bpy module may hang
"""


def imported(source: str) -> set[str]:
    """Top-level packages that a file imports absolutely."""
    nodes = list(ast.walk(ast.parse(source)))
    modules = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    modules += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.level == 0]
    return {module.split(".")[0] for module in modules}


def test_no_file_imports_the_folders_by_themselves():
    assert imported("def f():\n    from model.scene import View\nfrom .model import x\nimport a.b") == {"model", "a"}
    for path in python_files():
        assert not imported((ROOT / path).read_text(encoding="utf-8")) & {"model", "rf2_engine"}, path


def test_command_lines_load_one_package():
    run = subprocess.run([sys.executable, "-c", IMPORT_ALL], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    *modules, packages = run.stdout.splitlines()
    assert {"tools.render", "tools.parity.__main__", "tools.train.network"} <= set(modules)
    assert packages == "renderformer_v2"
