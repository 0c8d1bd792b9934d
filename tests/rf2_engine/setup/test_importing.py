# SPDX-License-Identifier: GPL-3.0-or-later
"""A PyTorch that cannot be imported: what the user reads, at the first F12 and at the next."""
import os
import subprocess
import sys

import pytest

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


@pytest.mark.parametrize("name", ["torch", "safetensors"])
def test_the_first_error_is_shown_again_and_again(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text(BROKEN)
    done = subprocess.run([sys.executable, "-c", F12_TWICE, str(tmp_path)], capture_output=True, text=True,
                          env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"}, timeout=120)
    first, second = [line for line in done.stdout.splitlines() if line.startswith("SAID")]
    assert first == second and f"{name} cannot be loaded: OSError: libcudnn.so.9: cannot open" in first
    assert str(tmp_path / name) in first and "NVIDIA driver" in first and "start Blender again" in first
    assert "Internal error" not in first
