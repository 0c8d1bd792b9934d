# SPDX-License-Identifier: GPL-3.0-or-later
"""Preflight: what a render will be made of, told before it, and nothing of the user's touched."""
import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import preflight as panel_module
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import costs, last_render

from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine.f12 import cube, mesh_object, press_f12, sun
from tests.rf2_engine.layout import Layout


@pytest.fixture(autouse=True)
def nothing_learned(scene, monkeypatch):  # after the add-on has read what it knows
    monkeypatch.setattr(costs, "_measured", {})
    monkeypatch.setattr(costs, "_memory", {})


def look(scene) -> preflight.Preflight:
    bpy.context.window.scene = scene
    assert bpy.ops.renderformer_v2.preflight() == {"FINISHED"}
    return preflight.last[scene.name]


def drawn() -> Layout:
    panel = type("Panel", (), {"layout": Layout()})()
    panel_module.RENDERFORMER_PT_preflight.draw_header_preset(panel, bpy.context)
    panel_module.RENDERFORMER_PT_preflight.draw(panel, bpy.context)
    return panel.layout


def test_it_tells_what_the_render_then_tells(scene, tmp_path):
    sun(scene)
    cube(scene)
    cube(scene, "Catcher", location=(2, 0, 0)).is_shadow_catcher = True
    mesh_object(scene, "Broken", [(0, 0, 0), (1, 0, float("nan")), (0, 1, 0)], [(0, 1, 2)])
    scene.render.resolution_percentage = 200
    before = look(scene)
    assert before.seconds is None and before.memory is None and "unknown" in " ".join(before.lines)
    press_f12(scene, tmp_path)
    (rendered,) = last_render.last_frame
    assert (before.size, before.triangles, before.tokens) == (rendered.size, rendered.triangles, rendered.tokens)
    assert before.remarks == rendered.remarks
    after = look(scene)
    assert 0 < after.seconds < 20 * rendered.picture_seconds and after.memory > 100
    layout = drawn()
    assert layout.texts[:2] == [str(sum(remark.kind == kind for remark in before.remarks))
                                for kind in ("approximated", "refused")]
    assert any("Catcher" in getattr(o, "name", "") for o in layout.operators)
    assert "triangles" in preflight.as_text(scene) and "Catcher" in preflight.as_text(scene)
    assert bpy.ops.renderformer_v2.copy_report(source="PREFLIGHT") == {"FINISHED"}


def test_published_weights_say_what_they_were_not_trained_for(scene, tmp_path):
    folder = write_bundle(tmp_path / "renderformer-v2", tiny_published_config(), ("transformer_2048",))
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", str(folder)
    cube(scene)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.data.energy, lamp.location = 50, (0, 0, 0.5)
    scene.collection.objects.link(lamp)
    before = look(scene)
    press_f12(scene, tmp_path)
    (rendered,) = last_render.last_frame
    assert before.remarks == rendered.remarks
    lines = [remark.message for remark in rendered.remarks if remark.name == "Published Weights"]
    assert any("inside the scene" in line for line in lines)
    assert any("has only transformer_2048" in line for line in lines)
    scene.renderformer_v2.transformer = "transformer_2048"
    assert not any("has only" in remark.message for remark in look(scene).remarks)
    scene.renderformer_v2.transformer = "transformer_512"
    with pytest.raises(RuntimeError, match="transformer_512"):
        press_f12(scene, tmp_path)


@pytest.mark.parametrize("budget, as_is, told", [(256, False, True), (16384, False, False), (256, True, False)])
def test_too_few_triangles_for_published_weights_are_said(scene, tmp_path, budget, as_is, told):
    folder = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    ours = scene.renderformer_v2
    ours.weights_source, ours.weights_folder, ours.max_edge = "FOLDER", str(folder), 0.05
    ours.token_budget, ours.as_is = budget, as_is
    cube(scene)
    found = look(scene)
    assert any(f"fills Max Triangles ({budget}): the weights know 16384 well" in remark.message
               for remark in found.remarks) == told
    bpy.ops.renderformer_v2.suggested_budget()
    assert ours.token_budget == 16384


def test_all_view_layers_are_counted(scene, tmp_path):
    cube(scene)
    press_f12(scene, tmp_path)
    one = look(scene)
    scene.view_layers.new("Second")
    two = look(scene)
    assert two.layers == 2 and two.seconds > 1.2 * one.seconds and "one of 2" in two.lines[0]


def test_a_render_without_the_network_says_nothing_of_its_memory(scene, tmp_path):
    cube(scene, location=(0, -50, 0))  # behind the camera
    press_f12(scene, tmp_path)
    found = look(scene)
    assert last_render.last_frame[0].tokens == 0 and found.memory is None and found.seconds is None


def test_nothing_of_the_user_changes(scene):
    box, lamp = cube(scene), sun(scene)
    box.select_set(True)
    bpy.context.view_layer.objects.active = lamp
    scene.frame_set(7)
    bpy.data.images.new("Painted", 4, 4)

    def state():
        blocks = sorted((block.bl_rna.name, block.name, block.users) for name in dir(bpy.data)
                        if isinstance(blocks := getattr(bpy.data, name), bpy.types.bpy_prop_collection)
                        for block in blocks)
        return (blocks, [each.name for each in bpy.context.selected_objects], bpy.context.view_layer.objects.active,
                scene.frame_current, bpy.data.is_dirty)

    before = state()
    look(scene)
    assert state() == before
    assert "UNDO" not in panel_module.RENDERFORMER_OT_preflight.bl_options


def test_what_renders_hide_is_not_counted_and_what_the_viewport_hides_is_named(scene):
    cube(scene)
    alone = look(scene).triangles
    cube(scene, "Unseen", (2, 0, 0)).hide_render = True
    inside = bpy.data.collections.new("Inside")
    scene.collection.children.link(inside)
    inside.objects.link(behind := cube(scene, "Behind"))
    scene.collection.objects.unlink(behind)
    inside.hide_render = True
    assert look(scene).triangles == alone
    cube(scene, "Curtain", (2, 0, 0)).hide_viewport = True
    rough = cube(scene, "Rough", (4, 0, 0)).modifiers.new("Smooth", "SUBSURF")
    rough.levels, rough.render_levels = 0, 2
    lines = preflight.as_text(scene) if look(scene) else ""
    assert "Curtain: hidden in the viewport" in lines and "Rough: modifiers, or their levels, differ" in lines
    assert "Unseen" not in lines and "Behind" not in lines


def test_what_a_render_would_refuse_is_said(scene):
    cube(scene)
    scene.camera.data.type = "CUSTOM"
    found = look(scene)
    assert "Perspective" in found.error and any("Perspective" in text for text in drawn().texts)
    scene.camera.data.type, scene.camera.data.stereo.use_spherical_stereo = "PANO", True
    assert not look(scene).error
    scene.render.use_multiview = True
    assert "Spherical Stereo" in look(scene).error


def test_a_folder_without_weights_is_refused_as_by_a_render(scene, tmp_path):
    cube(scene)
    (tmp_path / "empty").mkdir()
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", str(tmp_path / "empty")
    found = look(scene)
    with pytest.raises(RuntimeError) as refused:
        bpy.ops.render.render(scene=scene.name)
    assert "holds no weights" in found.error and found.error in str(refused.value)


def test_what_was_found_is_out_of_date_when_the_settings_change(scene):
    cube(scene)
    look(scene)
    assert not any("changed" in text for text in drawn().texts)
    for owner, name, value in ((scene.renderformer_v2, "token_budget", 512), (scene.render, "resolution_x", 64),
                               (scene.view_layers[0], "use_pass_diffuse_direct", True)):
        setattr(owner, name, value)
        assert any("changed" in text for text in drawn().texts), name
        look(scene)
        assert not any("changed" in text for text in drawn().texts), name


def test_the_cost_of_blur_is_said(scene, tmp_path):
    cube(scene)
    assert "blur" not in " ".join(look(scene).lines)
    press_f12(scene, tmp_path)
    scene.render.use_motion_blur = scene.camera.data.dof.use_dof = True
    assert "Depth of field and motion blur: 2 pictures for one, about 2 times as long" in " ".join(look(scene).lines)
    press_f12(scene, tmp_path)
    assert "times as long" in " ".join(look(scene).lines)


@pytest.mark.parametrize("seconds, words", [(0.04, "0.0 s"), (9.4, "9.4 s"), (19.2, "19 s"), (59.7, "1:00 min"),
                                            (125, "2:05 min")])
def test_less_than_a_minute_is_told_in_seconds(seconds, words):
    assert f"about {words}, " in " ".join(preflight.Preflight("Layer", seconds=seconds).lines)


def test_it_never_takes_long(scene, monkeypatch):
    cube(scene)
    monkeypatch.setattr(preflight, "LONGEST", -1.0)
    assert "so this is incomplete" in look(scene).error


def test_in_edit_mode_it_asks_to_leave_it(scene):
    bpy.context.window.scene = scene
    bpy.context.view_layer.objects.active = cube(scene)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.renderformer_v2.preflight()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_another_file_forgets_it(scene):
    look(scene)
    bpy.ops.wm.read_homefile(use_empty=True)
    assert not preflight.last
