# SPDX-License-Identifier: GPL-3.0-or-later
"""What Last Render shows: every view layer of the last frame, with its own numbers, report or error."""
import bpy
import OpenEXR
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.panels import last_render as panels
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import remarks
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status

from tests.rf2_engine.f12 import cube, mesh_object, press_f12, sun
from tests.rf2_engine.layout import Layout


@pytest.fixture
def layers(scene):
    """The view layers "Full" and "Bare", which lacks the cube."""
    sun(scene)
    inside = bpy.data.collections.new("Inside")
    scene.collection.children.link(inside)
    added = cube(scene)
    scene.collection.objects.unlink(added)
    inside.objects.link(added)
    scene.view_layers[0].name = "Full"
    bare = scene.view_layers.new("Bare")
    bare.layer_collection.children["Inside"].exclude = True
    return scene


def drawn() -> list[str]:
    return shown().texts


def shown(method="draw") -> Layout:
    panel = type("Panel", (), {"layout": Layout()})()
    getattr(panels.RENDERFORMER_PT_report, method)(panel, bpy.context)
    return panel.layout


def test_every_view_layer_keeps_its_numbers(layers, tmp_path):
    press_f12(layers, tmp_path)
    press_f12(layers, tmp_path)
    full, bare = last_render.last_frame
    assert (full.layer, bare.layer) == ("Full", "Bare") and full.triangles > bare.triangles
    texts = drawn()
    assert texts.index("Full") < texts.index("Bare")
    assert {f"{layer.triangles} triangles for the network" for layer in (full, bare)} <= set(texts)


def test_one_view_layer_needs_no_name(layers, tmp_path):
    layers.view_layers["Bare"].use = False
    press_f12(layers, tmp_path)
    assert "Full" not in drawn() and any("triangles" in text for text in drawn())


def test_an_error_in_one_view_layer_stays_beside_the_others(layers, tmp_path):
    layers.view_layers["Full"].world_override = broken = bpy.data.worlds.new("Broken")
    broken.use_nodes = True
    broken.node_tree.nodes["Background"].inputs["Strength"].default_value = float("nan")
    press_f12(layers, tmp_path, may_fail=True)
    full, bare = last_render.last_frame
    assert any("Broken" in line for line in full.report) and not any("Broken" in line for line in bare.report)
    assert any("Broken" in text for text in drawn())


def test_a_render_that_fails_before_its_first_frame_leaves_no_numbers_of_another(layers, tmp_path):
    press_f12(layers, tmp_path)
    layers.render.use_border, layers.render.border_max_x = True, 0
    with pytest.raises(RuntimeError, match="too small"):
        bpy.ops.render.render(scene=layers.name)
    assert not last_render.last_frame


def test_a_line_of_the_report_selects_its_object(layers, tmp_path):
    catcher = cube(layers, "Catcher", location=(1, 0, 0))
    catcher.is_shadow_catcher = True
    press_f12(layers, tmp_path)
    (select, *_) = [o for o in shown().operators if getattr(o, "name", "") == "Catcher"]
    assert "shadow catcher" in select.remark
    bpy.context.window.scene = layers
    layers.view_layers["Full"].objects.active = None
    bpy.ops.renderformer_v2.select_reported(name=select.name)
    assert catcher.select_get() and bpy.context.view_layer.objects.active == catcher
    assert [each.name for each in bpy.context.selected_objects] == ["Catcher"]


def test_the_report_is_counted_copied_printed_and_saved_with_the_picture(layers, tmp_path, capsys):
    layers.view_layers["Bare"].use = False
    cube(layers, "Catcher", location=(1, 0, 0)).is_shadow_catcher = True
    mesh_object(layers, "Broken", [(0, 0, 0), (1, 0, float("nan")), (0, 1, 0)], [(0, 1, 2)])
    press_f12(layers, tmp_path)
    lines = last_render.last_frame[0].report
    assert any("Catcher" in line for line in lines) and any("Broken" in line for line in lines)
    printed = capsys.readouterr().out.splitlines()
    assert [line for line in printed if "RenderFormer-V2: " in line] == [f"RenderFormer-V2: {line}" for line in lines]
    panel = shown("draw_header_preset")
    kinds = [remark.kind for remark in last_render.last_frame[0].remarks]
    assert panel.texts == [str(kinds.count(kind)) for kind in ("approximated", "refused")]
    assert [o.source for o in shown().operators if hasattr(o, "source")] == ["LAST_RENDER"]
    assert bpy.ops.renderformer_v2.copy_report(source="LAST_RENDER") == {"FINISHED"}
    assert last_render.as_text().splitlines()[-len(lines):] == lines
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert file.header()["RenderFormer-V2 report"].splitlines() == lines


def test_many_things_without_room_are_one_line_everywhere_that_opens_in_the_panel(layers, tmp_path, capsys):
    layers.view_layers["Bare"].use = False
    for i in range(25):
        box = cube(layers, f"Box {i}", location=(i / 20, 0, i / 20))
        for bit, rays in enumerate(("diffuse", "glossy", "transmission", "volume_scatter", "shadow")):
            setattr(box, f"visible_{rays}", not i >> bit & 1)  # or they would be joined
    layers.renderformer_v2.token_budget = 256
    press_f12(layers, tmp_path)
    lost = [remark for remark in last_render.last_frame[0].remarks if remark.kind == "unplaced"]
    printed = capsys.readouterr().out
    assert len(lost) > 3 and f"unplaced {len(lost)} (Box" in printed and "Max Triangles" in printed
    (line,) = [line for line in last_render.as_text().splitlines() if line.startswith("unplaced")]
    assert line in printed and line in last_render.last_frame[0].report
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert line in file.header()["RenderFormer-V2 report"].splitlines()
    assert f"and {len(lost) - 3} more" in printed and "have no room within" in printed
    assert "not in the picture" not in printed
    opened = shown()
    assert len([text for text in opened.texts if "Max Triangles" in text]) <= 2
    assert len([o for o in opened.operators if getattr(o, "remark", "").startswith("unplaced")]) == len(lost)


def test_a_render_of_another_engine_leaves_ours_which_another_slot_shows(layers, tmp_path):
    press_f12(layers, tmp_path)
    before = list(last_render.last_frame)
    layers.render.engine, layers.cycles.samples = "CYCLES", 1
    press_f12(layers, tmp_path)
    assert before and last_render.last_frame == before
    layers.render.engine = "RENDERFORMER_V2"
    press_f12(layers, tmp_path)
    assert len(last_render.last_frame) == len(before) and last_render.last_frame[0] is not before[0]


def test_another_file_has_no_picture_and_no_report(layers, tmp_path):
    press_f12(layers, tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert last_render.last_frame  # the picture is there, too
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert not bpy.data.images["Render Result"].has_data and not last_render.last_frame
    assert drawn() == ["No render yet"]


def test_drawing_looks_the_names_of_a_report_up_once(layers, tmp_path):
    for i in range(3):
        cube(layers, f"Catcher {i}", location=(i, 0, 0)).is_shadow_catcher = True
    press_f12(layers, tmp_path)
    passes = []

    class Scene:
        name = layers.name

        @property
        def objects(self):
            passes.append(1)
            return layers.objects
    for _ in range(3):
        layout = Layout()
        remarks.draw_remarks(layout, last_render.last_frame[0], Scene())
        assert {o.name for o in layout.operators} >= {f"Catcher {i}" for i in range(3)}
    assert len(passes) == 1


def test_a_line_about_a_material_selects_what_wears_it(layers):
    worn = layers.objects["Cube"]
    assert remarks.find_users(layers, worn.active_material.name) == [worn]
    assert not remarks.find_users(layers, "nothing")


def test_a_cancelled_render_says_so(layers, tmp_path, monkeypatch):
    press_f12(layers, tmp_path)
    monkeypatch.setattr(Status, "esc_pressed", lambda status: True)
    bpy.ops.render.render(scene=layers.name)
    assert "Cancelled" in drawn() and not any("triangles" in text for text in drawn())
