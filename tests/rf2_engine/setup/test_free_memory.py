# SPDX-License-Identifier: GPL-3.0-or-later
"""Free Memory, while a render uses the network and afterwards."""
import bpy

from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache

from tests.rf2_engine.f12 import press_f12


def test_the_memory_of_the_network_cannot_be_freed_while_it_renders(lit, tmp_path, monkeypatch):
    press_f12(lit, tmp_path)
    allowed = {}

    def look(status):
        allowed[status._shown[0]] = bpy.ops.renderformer_v2.free_model.poll()
        return False
    monkeypatch.setattr(Status, "esc_pressed", look)
    press_f12(lit, tmp_path)
    assert "Network" in allowed and not any(allowed.values())
    assert bpy.ops.renderformer_v2.free_model() == {"FINISHED"} and not model_cache.is_loaded()
