# SPDX-License-Identifier: GPL-3.0-or-later
"""F12 with the installed extension: pixels, passes, alpha, borders, layers, frames, cancelling."""

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import run as cycles_run
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session_overrides
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status

from tests.rf2_engine.f12 import cube, material, press_f12, sun
from tests.rf2_engine.still_life import tick

EXACT = 1e-6


def names(source):
    return {p.blender_name for p in passes.PASSES if p.source == source}


def test_renders_a_lit_cube_and_writes_every_pass(scene, tmp_path):
    cube(scene)
    sun(scene)
    tick(scene.view_layers[0], {p.key for p in passes.PASSES if p.source == "guide"})
    found = press_f12(scene, tmp_path)
    assert {f"ViewLayer.{name}" for name in names("network") | names("guide")} <= set(found)
    for pixels in found.values():
        assert pixels.shape[:2] == (37, 50) and np.isfinite(pixels).all()
    front = found["ViewLayer.Combined"][15:22, 20:30, :3]
    assert front.min() > 0.01
    assert np.allclose(found["ViewLayer.Position"][15:22, 20:30, 1], -1, atol=1e-4)
    assert np.allclose(found["ViewLayer.Normal"][15:22, 20:30], (0, -1, 0), atol=1e-4)
    assert np.allclose(found["ViewLayer.Depth"][15:22, 20:30].squeeze(), 4, atol=0.2)


@pytest.mark.parametrize("light", ["TRACED", "TRANSFORMER"])
def test_reports_stages_tokens_and_triangles(scene, tmp_path, light):
    cube(scene)
    scene.renderformer_v2.light = light
    press_f12(scene, tmp_path)
    (last,) = last_render.last_frame
    assert last.triangles >= 12 and last.size == (50, 37)
    assert last.tokens > last.triangles if light == "TRANSFORMER" else last.tokens == 0
    assert {"Converting the scene", "Camera rays", "Network"} <= set(last.seconds)


def test_opaque_film_shows_the_world_and_transparent_film_does_not(scene, tmp_path):
    cube(scene)
    scene.renderformer_v2.guide_samples = 8
    opaque = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    scene.render.film_transparent = True
    clear = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert (opaque[..., 3] == 1).all() and np.allclose(opaque[0, 0, :3], 0.25, atol=EXACT)
    assert (clear[0, 0] == 0).all() and np.allclose(clear[18, 25, 3], 1, atol=EXACT)
    edge = (clear[..., 3] > 0.05) & (clear[..., 3] < 0.95)
    assert edge.any()
    background = opaque[..., :3] - clear[..., :3]
    assert np.allclose(background, 0.25 * (1 - clear[..., 3:]), atol=1e-4)


def test_pictures_larger_than_a_tile_of_cycles_are_whole(scene, tmp_path):
    cube(scene)
    whole = press_f12(scene, tmp_path)
    scene.cycles.use_auto_tile, scene.cycles.tile_size = True, 16
    tiled = press_f12(scene, tmp_path)
    assert (whole["ViewLayer.Combined"] == tiled["ViewLayer.Combined"]).all()
    assert scene.cycles.tile_size == 16


@pytest.mark.slow
def test_pictures_wider_than_the_largest_tile_of_cycles_are_whole(scene, tmp_path):
    cube(scene)
    scene.render.resolution_x, scene.render.resolution_y = 8200, 16
    scene.view_layers[0].use_pass_z = True
    found = press_f12(scene, tmp_path)
    assert np.allclose(found["ViewLayer.Combined"][0, [0, -1], :3], 0.25, atol=EXACT)
    assert found["ViewLayer.Depth"][8, 4100] < 10 and found["ViewLayer.Combined"][8, 4100, :3].min() > 0.01


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_a_scene_without_light_is_black(scene, tmp_path, light):
    cube(scene).rotation_euler = (0.3, 0.2, 0.5)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.renderformer_v2.light = light
    assert press_f12(scene, tmp_path)["ViewLayer.Combined"][..., :3].max() < 1e-4


def test_film_exposure_scales_the_picture(scene, tmp_path):
    cube(scene)
    once = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    scene.cycles.film_exposure = 2
    twice = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.allclose(twice[..., :3], 2 * once[..., :3], rtol=1e-4)


@pytest.mark.parametrize("size, percentage", [((50, 37), 100), ((129, 71), 50), ((64, 33), 33)])
@pytest.mark.parametrize("crop", [False, True])
def test_border_holds_the_same_pixels_as_the_full_frame(scene, tmp_path, size, percentage, crop):
    cube(scene).rotation_euler = (0.3, 0.2, 0.5)
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = percentage
    width, height = (s * percentage // 100 for s in size)
    scene.view_layers[0].use_pass_position = True
    full = press_f12(scene, tmp_path)["ViewLayer.Position"]
    assert full.shape == (height, width, 3)

    settings = scene.render
    settings.use_border, settings.use_crop_to_border = True, crop
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.21, 0.83, 0.13, 0.61
    x0, x1, y0, y1 = int(0.21 * width), int(0.83 * width), int(0.13 * height), int(0.61 * height)
    found = press_f12(scene, tmp_path)
    part, picture = found["ViewLayer.Position"], found["ViewLayer.Combined"]
    if not crop:
        assert part.shape == full.shape
        part, picture = part[height - y1:height - y0, x0:x1], picture[height - y1:height - y0, x0:x1]
    assert part.shape == (y1 - y0, x1 - x0, 3)
    assert np.allclose(part, full[height - y1:height - y0, x0:x1], atol=1e-4)
    assert picture[..., :3].min() > 0


def test_every_view_layer_gets_its_own_picture(scene, tmp_path):
    red = bpy.data.collections.new("Red")
    scene.collection.children.link(red)
    added = cube(scene, of=material("Red", (0.8, 0.05, 0.05)))
    scene.collection.objects.unlink(added)
    red.objects.link(added)
    empty = scene.view_layers.new("Without")
    empty.layer_collection.children["Red"].exclude = True
    scene.view_layers[0].use_pass_diffuse_color = True
    found = press_f12(scene, tmp_path)
    assert found["ViewLayer.DiffCol" if "ViewLayer.DiffCol" in found else "ViewLayer.Diffuse Color"][18, 25, 0] > 0.5
    assert np.allclose(found["Without.Combined"][18, 25], (0.25, 0.25, 0.25, 1), atol=EXACT)
    assert not np.allclose(found["ViewLayer.Combined"][18, 25], found["Without.Combined"][18, 25], atol=1e-3)


def test_world_of_a_view_layer_lights_it(scene, tmp_path):
    cube(scene)
    blue = bpy.data.worlds.new("Blue")
    blue.use_nodes = True
    blue.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 1, 1)
    scene.view_layers[0].world_override = blue
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert (picture[0, 0] == (0, 0, 1, 1)).all()
    red, _, most = picture[15:22, 20:30, :3].mean(axis=(0, 1))
    assert most > 0.1 and red < 0.2 * most


@pytest.mark.parametrize("persistent", [False, True])
def test_animation_renders_each_frame(scene, tmp_path, persistent):
    moving = cube(scene, of=material("Red", (0.9, 0.02, 0.02)))
    moving.keyframe_insert("location", frame=1)
    moving.location.x = 8
    moving.keyframe_insert("location", frame=2)
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.use_persistent_data = persistent
    scene.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True, scene=scene.name)
    frames = [bpy.data.images.load(str(tmp_path / f"frame_{i:04d}.png")) for i in (1, 2)]
    first, second = (np.array(f.pixels).reshape(37, 50, 4) for f in frames)
    assert np.abs(first - second)[18, 25, :3].max() > 0.02
    assert scene.render.film_transparent is False and scene.cycles.max_bounces > 0


def test_data_passes_are_written_when_ticked(scene, tmp_path):
    cube(scene).pass_index = 7
    layer = scene.view_layers[0]
    layer.use_pass_object_index = layer.use_pass_mist = True
    found = press_f12(scene, tmp_path)
    index = next(found[f"ViewLayer.{name}"] for name in ("IndexOB", "Object Index") if f"ViewLayer.{name}" in found)
    assert index.squeeze()[18, 25] == 7 and index.squeeze()[0, 0] == 0
    assert "ViewLayer.Mist" in found


@pytest.mark.parametrize("polls_before_esc", [0, 2, 5])
def test_esc_ends_the_render_at_once_and_writes_no_picture(scene, tmp_path, monkeypatch, polls_before_esc):
    """Nobody can press Esc without a window, so the answer to 'was it pressed?' is given here."""
    cube(scene)
    press_f12(scene, tmp_path)
    polls = []

    def pressed(status):
        polls.append(status)
        return len(polls) > polls_before_esc
    monkeypatch.setattr(Status, "esc_pressed", pressed)
    bpy.ops.render.render(scene=scene.name)
    assert len(polls) == polls_before_esc + 1  # nothing that asks is begun after it was pressed
    assert last_render.last_frame[-1].cancelled and not last_render.last_frame[-1].triangles


def test_while_the_network_works_the_frame_shows_unlit_colours(scene, tmp_path, monkeypatch):
    cube(scene, of=material("Copper", color=(0.8, 0.4, 0.2)))
    sun(scene)
    scene.renderformer_v2.light = "NETWORK"  # there is no traced light to show
    seen = []

    def look(status):
        if status._displayed[0] == "Network" and not seen:
            layer = status.engine.get_result().layers["ViewLayer"]
            pixels = np.array(next(p for p in layer.passes if p.name == "Combined").rect)
            seen.append(pixels.reshape(37, 50, 4)[15:22, 20:30, :3].mean(axis=(0, 1)))
        return False
    monkeypatch.setattr(Status, "esc_pressed", look)
    press_f12(scene, tmp_path)
    (unlit,) = seen
    assert np.allclose(unlit / unlit[0], (1, 0.5, 0.25), atol=0.05) and unlit[0] > 0.8  # base colour and specular


@pytest.mark.parametrize("stage, light, kept", [
    ("Finding visible surfaces", "TRACED", False), ("Network", "TRACED", True), ("Network", "NETWORK", False)])
def test_esc_leaves_what_was_traced_and_the_other_passes(scene, tmp_path, monkeypatch, capfd, stage, light, kept):
    scene.renderformer_v2.light = light
    sun(scene)
    shining = material("Shining")
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 2
    cube(scene, of=shining)
    cube(scene, "Ground", (0, -2, -3))  # light bounces from here
    tick(scene.view_layers[0], {"normal", "emission", "environment"})
    finished = press_f12(scene, tmp_path)
    monkeypatch.setattr(Status, "esc_pressed", lambda status: status._displayed[0] == stage)
    cancelled = press_f12(scene, tmp_path)
    assert last_render.last_frame[-1].cancelled and not last_render.last_frame[-1].triangles
    traced = cancelled["ViewLayer.Combined"]
    assert traced.any() == kept == ("as it was shown last" in capfd.readouterr().out)
    assert not kept or 0 < traced[15:22, 20:30, :3].mean() < finished["ViewLayer.Combined"][15:22, 20:30, :3].mean()
    pictures = {"ViewLayer.Combined", "ViewLayer.Noisy Image"}
    smoothed = {f"ViewLayer.{p.blender_name}" for p in passes.PASSES if p.key in ("emission", "environment")}
    assert all(np.array_equal(cancelled[name], finished[name]) for name in finished.keys() - smoothed - pictures)
    assert all((cancelled[name] > 0).any() for name in smoothed if (finished[name] > 0).any())


@pytest.mark.parametrize("persistent", [False, True])
def test_first_hits_are_taken_without_light_and_the_scene_keeps_it(scene, tmp_path, monkeypatch, persistent):
    cube(scene)
    lamp = sun(scene)
    scene.renderformer_v2.light, scene.render.use_persistent_data = "NETWORK", persistent
    taken = []

    def read(*arguments, real=cycles_run._read):
        found = real(*arguments)
        taken.append(found[""]["combined"])
        return found
    monkeypatch.setattr(cycles_run, "_read", read)
    press_f12(scene, tmp_path)
    assert (taken[0][15:22, 20:30, :3] == 0).all()
    scene.render.engine = "CYCLES"
    lit = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert lit[15:22, 20:30, :3].min() > 0.01 and lamp.visible_diffuse


@pytest.mark.parametrize("persistent", [False, True])
def test_a_failure_while_cycles_is_prepared_leaves_no_override_behind(scene, tmp_path, monkeypatch, persistent):
    cube(scene)
    sun(scene)
    scene.renderformer_v2.light, scene.render.use_persistent_data = "NETWORK", persistent
    whole = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    with monkeypatch.context() as broken:
        broken.setitem(session_overrides._UNLIT, "visible_shadow", "no such value")
        with pytest.raises(RuntimeError, match="no such value|expected"):
            bpy.ops.render.render(scene=scene.name)
    again = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert (again[..., 3] == 1).all() and np.allclose(again, whole, atol=1e-5)
