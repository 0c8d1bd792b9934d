# SPDX-License-Identifier: GPL-3.0-or-later
"""A Rendered viewport as Blender calls it, with Blender's own region, the worker's thread and the handlers of changes.

Without a window nothing is drawn: only the pixels that would be are looked at.
"""
import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

import addon_utils
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime.worker import worker
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import viewport

from tests.rf2_engine.f12 import cube, material, sun
from tests.rf2_engine.viewport.views import depsgraph

PATIENCE = 120  # seconds, of a machine that does much else
RED, GREEN = (0.8, 0.02, 0.02), (0.02, 0.8, 0.02)


class Engine:
    """What a viewport asks of the engine that Blender makes for it."""

    def __init__(self):
        self.redraws = 0

    def tag_redraw(self):
        self.redraws += 1

    def update_stats(self, stats, info):
        self.info = info


@pytest.fixture
def context(scene):
    """Of the first 3D viewport of Blender's screen, 96 x 64 pixels."""
    scene.renderformer_v2.viewport.resolution = "4"
    area = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    space = area.spaces.active
    space.region_3d.view_perspective = "CAMERA"
    return SimpleNamespace(space_data=space, region=SimpleNamespace(width=96, height=64),
                           region_data=space.region_3d, preferences=bpy.context.preferences)


def shown(engine, context) -> np.ndarray:
    """The finest picture, (H, W, 4), once the worker's thread has made it."""
    begin = time.monotonic()
    while time.monotonic() - begin < PATIENCE:
        viewport.update(engine, context, depsgraph())
        session = engine.viewport.session
        assert not session.error, session.error
        if engine.viewport.source.version and not session.has_work():
            return session.displayed.pixels
        time.sleep(0.01)
    raise TimeoutError(session.activity)


def test_a_picture_appears_and_follows_what_is_edited(scene, context):
    paint = material("Paint", RED)
    cube(scene, of=paint)
    sun(scene)
    engine = Engine()
    red = shown(engine, context)
    assert red.shape == (16, 24, 4) and np.isfinite(red).all() and engine.redraws > 0
    middle = red[6:10, 10:14, :3].mean((0, 1))
    assert middle[0] > 1.5 * middle[1] > 0
    paint.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*GREEN, 1)
    bpy.context.view_layer.update()
    middle = shown(engine, context)[6:10, 10:14, :3].mean((0, 1))
    assert middle[1] > 1.5 * middle[0] > 0


@pytest.mark.parametrize("is_told_of_nothing", [False, True])
def test_a_change_that_no_handler_is_told_of_is_shown_too(scene, context, is_told_of_nothing):
    """What a handler of frame changes edits is evaluated after it, with a call of `update` alone."""
    paint = material("Paint", RED)
    cube(scene, of=paint)
    sun(scene)
    engine, handlers = Engine(), bpy.app.handlers.depsgraph_update_post
    shown(engine, context)
    if is_told_of_nothing:
        viewport.note_changes(scene, depsgraph())

    def update(_, evaluated):
        viewport.update(engine, context, evaluated)

    handlers.remove(viewport.note_changes)
    handlers.append(update)
    try:
        paint.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*GREEN, 1)
        bpy.context.view_layer.update()
    finally:
        handlers.remove(update)
        handlers.append(viewport.note_changes)
    middle = shown(engine, context)[6:10, 10:14, :3].mean((0, 1))
    assert middle[1] > 1.5 * middle[0] > 0


def test_cycles_switched_off_is_said_in_the_viewport_until_it_is_on_again(scene, context, monkeypatch):
    drawn = []
    monkeypatch.setattr(viewport, "draw_message", lambda text, *size: drawn.append(text))  # there is no window
    cube(scene)
    engine = Engine()
    addon_utils.disable("cycles")
    try:
        viewport.update(engine, context, depsgraph())
        viewport.draw(engine, context, depsgraph())
    finally:
        addon_utils.enable("cycles")
    assert len(drawn) == 1 and "Cycles" in drawn[0] and "Preferences > Add-ons" in drawn[0] and "Cycles" in engine.info
    assert shown(engine, context)[..., 3].any()


def test_a_viewport_that_is_closed_is_forgotten(scene, context):
    cube(scene)
    engine = Engine()
    shown(engine, context)
    session = engine.viewport.session
    assert session in worker.works()
    del engine
    assert session.closed and session.displayed is None


@pytest.mark.parametrize("path, value", [
    ("viewport.token_budget", 300), ("viewport.resolution", "8"), ("viewport.time_limit", 3.0), ("max_edge", 0.1),
    ("as_is", True), ("paper_lamps", True), ("precision", "bf16"), ("device", "cpu"), ("card", 2),
    ("transformer", "transformer_2048"), ("threads_mode", "FIXED"), ("threads", 3), ("weights_source", "FOLDER"),
    ("weights_folder", "/")])
def test_a_viewport_follows_what_a_script_sets(scene, path, value):
    told, before = [], scene.renderformer_v2.path_resolve(path)
    bpy.context.view_layer.update()
    bpy.app.handlers.depsgraph_update_post.append(note := lambda *_: told.append(path))
    try:
        owner, _, name = path.rpartition(".")
        setattr(scene.renderformer_v2.path_resolve(owner) if owner else scene.renderformer_v2, name, value)
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert scene.renderformer_v2.path_resolve(path) != before and told
