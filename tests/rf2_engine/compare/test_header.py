# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare shows the view layer and the pass that the header of the Image Editor shows."""
import re
from types import SimpleNamespace

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.compare import header, sources
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.state import comparison
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render


@pytest.fixture
def editor(settings, two_slots, monkeypatch):
    """What an Image Editor shows of the render result, which only the mouse can choose: what Compare shows follows."""
    space = SimpleNamespace(layer=0, number=0, view=0)
    monkeypatch.setattr(header, "numbers", lambda image: (space.layer, space.number, space.view))
    settings.a.kind, settings.a.pass_name, settings.b.pass_name = "SHOWN", "", ""
    return space


def test_a_new_image_editor_shows_the_first_of_all(two_slots):
    area = bpy.context.window_manager.windows[0].screen.areas[0]
    before, area.type = area.type, "IMAGE_EDITOR"
    area.spaces.active.image = bpy.data.images["Render Result"]
    assert header.numbers(area.spaces.active.image) == (0, 0, 0)
    area.type = before


def test_the_pass_of_the_header_is_compared(editor, settings):
    comparison.read()
    settings.b.pass_name = "Combined"
    editor.number = 2
    assert comparison.is_outdated()
    comparison.read()
    assert comparison.a.name == "Slot 2, ViewLayer, Normal"


def test_the_layer_of_the_header_is_compared_and_not_the_first_by_name(editor, settings, two_slots):
    two_slots.view_layers.new("A")
    bpy.ops.render.render()
    settings.b.slot, settings.b.pass_name, settings.b.layer = 2, "Depth", "ViewLayer"
    found = []
    for editor.layer in (0, 1):
        comparison.read()
        found.append(comparison.a.name)
    assert found == ["Slot 2, ViewLayer, Combined", "Slot 2, A, Combined"]


def test_what_the_compositor_made_is_compared_where_the_header_shows_it(editor, settings, two_slots):
    compose(two_slots)
    bpy.ops.render.render()
    settings.b.kind, settings.b.pass_name = "SHOWN", "Depth"
    comparison.read()
    assert comparison.a.name == "Slot 2, Composite, Combined" and comparison.b.name == "Slot 2, ViewLayer, Depth"
    editor.layer = 1
    comparison.read()
    assert comparison.a.name == "Slot 2, ViewLayer, Combined"


def test_beside_a_reference_is_what_did_not_go_through_the_compositor(editor, settings, two_slots):
    compose(two_slots)
    two_slots.render.engine = "RENDERFORMER_V2"
    two_slots.renderformer_v2.reference.use, two_slots.renderformer_v2.reference.samples = True, 1
    bpy.ops.render.render()
    settings.b.kind = "SHOWN"
    comparison.read()
    assert [side.name for side in (comparison.a, comparison.b)] == [
        "Slot 2, ViewLayer, Combined", "Slot 2, ViewLayer, Cycles Reference"]
    settings.a.layer = "Composite"  # on purpose
    comparison.read()
    assert comparison.a.name == "Slot 2, Composite, Combined"


def test_a_composite_beside_a_render_is_said(editor, settings, two_slots):
    compose(two_slots)
    bpy.ops.render.render()
    settings.b.slot = 1  # rendered without a compositor

    def said():
        comparison.read()
        measurement = comparison.new_measurement()
        measurement.run()
        return " ".join(measurement.notes)
    assert "A went through the compositor and B did not" in said()
    settings.a.layer = "ViewLayer"
    assert "compositor" not in said()


def test_the_view_of_the_header_is_compared(editor, settings, two_slots):
    two_slots.render.use_multiview, two_slots.camera.data.stereo.interocular_distance = True, 0.5
    two_slots.renderformer_v2.reference.use, two_slots.renderformer_v2.reference.samples = True, 1
    two_slots.render.engine, settings.b.kind = "RENDERFORMER_V2", "SHOWN"
    bpy.ops.render.render()
    settings.b.pass_name = "Cycles Reference"
    comparison.read()
    assert comparison.a, comparison.message
    left = comparison.a.pixels
    assert comparison.a.name == "Slot 2, ViewLayer, Combined, left"
    editor.view = 1
    assert comparison.is_outdated()
    comparison.read()
    assert [side.name for side in (comparison.a, comparison.b)] == [
        "Slot 2, ViewLayer, Combined, right", "Slot 2, ViewLayer, Cycles Reference, right"]
    assert all(re.fullmatch(r"[^()]* \(right\)", label) for label in comparison.labels()[-1])
    assert str(comparison.b.credits).startswith("Cycles, 1 sample, ") and (comparison.a.pixels != left).any()
    settings.a.pass_name, editor.view = "Combined.right", 0
    comparison.read()
    assert comparison.a.name == "Slot 2, ViewLayer, Combined, right"
    assert comparison.b.name == "Slot 2, ViewLayer, Cycles Reference, left"


def compose(scene):
    """Through a compositor that changes nothing."""
    if hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        out = tree.nodes.new("NodeGroupOutput")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        out = tree.nodes.new("CompositorNodeComposite")
    tree.links.new(tree.nodes.new("CompositorNodeRLayers").outputs["Image"], out.inputs[0])


@pytest.mark.parametrize("engine", ["CYCLES", "RENDERFORMER_V2"])
def test_passes_are_in_the_order_of_the_result(editor, settings, two_slots, engine, monkeypatch):
    layer, orders = two_slots.view_layers[0], []
    layer.use_pass_mist = layer.use_pass_diffuse_color = layer.use_pass_emit = True
    layer.cycles.denoising_store_passes = True
    layer.use_pass_cryptomatte_object, two_slots.render.engine = True, engine
    layer.aovs.add().name = "Aa"
    two_slots.renderformer_v2.reference.use, two_slots.renderformer_v2.reference.samples = True, 1

    def look(engine, real=last_render.stamp):
        orders.append([p.name for p in engine.get_result().layers[0].passes])
        real(engine)
    monkeypatch.setattr(last_render, "stamp", look)
    bpy.ops.render.render()
    if engine == "CYCLES":
        from cycles.engine import list_render_passes
        orders.append([name for name, *_ in list_render_passes(two_slots, layer)])
    reader = sources.Reader(two_slots)
    reader.picture(settings.a)
    (file,), ticked = reader.files.values(), orders[0]
    ours = header.passes(file, "ViewLayer", two_slots)
    assert ours[0] == "Combined" and len(ours) > 8 and ours == [name for name in ticked if name in ours]
