# SPDX-License-Identifier: GPL-3.0-or-later
"""A PyTorch that cannot be imported or is too old: what the user reads, at the first F12 and at the next."""
import os
import subprocess
import sys

import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.setup import importing, packages

BROKEN = """
import sys
if hasattr(sys, "tried"):
    raise RuntimeError("the core can only be initialized once per process")
sys.tried = True
raise OSError("libcudnn.so.9: cannot open shared object file")
"""
F12_TWICE = """
import os, sys
sys.path.insert(0, sys.argv[1])
import bpy
from tools import extension
extension.load().register()
from renderformer_v2.rf2_engine.progress import last_render
bpy.context.scene.render.engine = "RENDERFORMER_V2"
bpy.context.scene.render.resolution_percentage = 2
bpy.context.scene.renderformer_v2.guide_samples = 1
for _ in range(2):
    try:
        bpy.ops.render.render()
    except RuntimeError:
        pass
    print("SAID", last_render.last_frame[-1].error if last_render.last_frame else "nothing", flush=True)
os._exit(0)
"""


def f12_twice(path, name: str) -> list[str]:
    """What two renders say with a package that cannot be imported in the folder `path`."""
    (path / name).mkdir()
    (path / name / "__init__.py").write_text(BROKEN)
    done = subprocess.run([sys.executable, "-c", F12_TWICE, str(path)], capture_output=True, text=True,
                          env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"}, timeout=600)
    return [line for line in done.stdout.splitlines() if line.startswith("SAID")]


@pytest.mark.parametrize("name, version, minimum", [("torch", "2.3.1+cu121", "2.4"), ("safetensors", "0.3.9", "0.4")])
def test_a_package_that_is_too_old_is_named_with_what_to_do(tmp_path, name, version, minimum):
    info = tmp_path / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    first, second = f12_twice(tmp_path, name)
    assert first == second and f"{name} {version} in {tmp_path} is too old" in first
    assert f"needs {name} {minimum} or newer" in first and f"pip install --upgrade {name}==" in first


def test_a_shared_folder_for_another_python_is_not_to_be_repaired_from_here(monkeypatch, tmp_path):
    error = ModuleNotFoundError("No module named 'torch._C'")
    monkeypatch.setattr(packages, "is_elsewhere", lambda name: False)
    assert "Repair Packages" in importing._explain("torch", error)
    monkeypatch.setenv(packages.PACKAGES_VARIABLE, str(tmp_path))
    said = importing._explain("torch", error)
    assert "Repair" not in said and f"{packages.PACKAGES_VARIABLE} names {tmp_path}: it has to be filled on" in said


def test_a_package_that_is_new_enough_or_says_no_version_is_used(tmp_path, monkeypatch):
    assert not packages.too_old()  # those that the tests run with
    monkeypatch.setattr(packages, "elsewhere", lambda name: tmp_path)
    assert not packages.too_old()
    (tmp_path / "torch-2.10.0.dist-info").mkdir()
    (tmp_path / "torch-2.10.0.dist-info" / "METADATA").write_text("Name: torch\nVersion: 2.10.0\n")
    packages._version.cache_clear()
    assert not packages.too_old()


@pytest.mark.parametrize("name", ["torch", "safetensors"])
def test_the_first_error_is_shown_again_and_again(tmp_path, name):
    first, second = f12_twice(tmp_path, name)
    assert first == second and f"{name} cannot be loaded: OSError: libcudnn.so.9: cannot open" in first
    assert str(tmp_path / name) in first and "NVIDIA driver" in first and "start Blender again" in first
    assert "Internal error" not in first
