# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender calls for a Rendered viewport, without a window."""
from types import SimpleNamespace

import bpy
import pytest

import addon_utils
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import viewport

from tests.rf2_engine.f12 import cube
from tests.rf2_engine.viewport.views import depsgraph


class Engine:
    def update_stats(self, *_):
        pass

    def tag_redraw(self):
        pass


@pytest.fixture
def without_cycles(scene):
    addon_utils.disable("cycles")
    assert not hasattr(scene, "cycles")
    yield scene
    addon_utils.enable("cycles")


def test_without_cycles_a_viewport_says_what_to_do(without_cycles, monkeypatch):
    cube(without_cycles)
    messages, engine = [], Engine()
    monkeypatch.setattr(viewport, "draw_message", lambda message, *_: messages.append(message))
    context = SimpleNamespace(region=SimpleNamespace(width=64, height=48), space_data=None, region_data=None,
                              preferences=bpy.context.preferences)
    for _ in range(2):
        viewport.update(engine, context, depsgraph())
        viewport.draw(engine, context, depsgraph())
    assert len(set(messages)) == 1 and "enable 'Cycles Render Engine' in Preferences > Add-ons" in messages[0]
    assert preflight.state_of(without_cycles, without_cycles.view_layers[0])  # whenever the panel is drawn
