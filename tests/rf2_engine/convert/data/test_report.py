# SPDX-License-Identifier: GPL-3.0-or-later
"""No difference without a line, by the name of what differs; and no line without a difference."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report, grouped

NAN, HUGE = float("nan"), 3e38


def emit(strength):
    def change(scene, rock):
        rock.active_material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = strength
    return change


def in_collection(**flags):
    def change(scene, rock):
        made = bpy.data.collections.new("Apart")
        scene.collection.children.link(made)
        scene.collection.objects.unlink(rock)
        made.objects.link(rock)
        for name, value in flags.items():
            setattr(scene.view_layers[0].layer_collection.children["Apart"], name, value)
    return change


def lamp(**settings):
    def change(scene, rock):
        made = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
        scene.collection.objects.link(made)
        for path, value in settings.items():
            setattr(made.data if hasattr(made.data, path) else made, path, value)
    return change


def portal(scene, rock):
    made = bpy.data.objects.new("Portal", bpy.data.lights.new("Portal", "AREA"))
    made.data.cycles.is_portal = True
    scene.collection.objects.link(made)


def spotted_lamp(scene, rock):
    lamp(use_nodes=True)(scene, rock)
    tree = bpy.data.lights["Lamp"].node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs["Color"], tree.nodes["Emission"].inputs["Color"])


def dark_world(scene, rock):
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = -1


def hair(scene, rock):
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([2] * 500)
    scene.collection.objects.link(bpy.data.objects.new("Hair", curves))


def bald(scene, rock):
    hair(scene, rock)
    scene.view_layers[0].use_strand = False


def drawing(scene, rock):
    drawings = bpy.data.grease_pencils_v3 if hasattr(bpy.data, "grease_pencils_v3") else bpy.data.grease_pencils
    scene.collection.objects.link(bpy.data.objects.new("Drawing", drawings.new("Drawing")))


@pytest.mark.parametrize("change, line", [
    (in_collection(), ""), (in_collection(indirect_only=True), ""),
    (in_collection(holdout=True), ""), (portal, ""),
    (lambda scene, rock: setattr(rock, "visible_camera", False), ""),
    (emit(0), ""), (emit(-1), "approximated Stone: negative light"), (dark_world, "approximated Grey: negative light"),
    (spotted_lamp, "approximated Lamp: node \"Noise Texture\""),
    (hair, "approximated Hair: the network sees"), (bald, ""),
    (drawing, "approximated Drawing: it is drawn over the picture"),
    (lambda scene, rock: setattr(rock, "scale", (1e25, 1e25, 1)), "refused Rock: its transform"),
    (lambda scene, rock: setattr(rock, "location", (NAN, 0, 0)), "refused Rock: its transform"),
    (lamp(shadow_soft_size=HUGE), "refused Lamp: its size"), (lamp(shadow_soft_size=1), ""),
    (lamp(energy=HUGE), "refused Lamp: its"),
])
def test_every_difference_has_its_line(scene, converted, add_mesh, add_material, report, change, line):
    rock = add_mesh("Rock", materials=[add_material("Stone")])
    change(scene, rock)
    found = converted()
    assert np.isfinite(found.triangles).all() and np.isfinite(found.emission).all()
    lines = [remark for remark in report.lines() if "Scale" not in remark]
    assert any(remark.startswith(line) for remark in lines) if line else not lines, lines


def test_what_is_said_of_several_things_is_one_sentence():
    report = Report()
    for i in range(5):
        report.unplaced(f"Box {i}", f"no room for {i} of its 9 instances")
    report.skipped("Box 0", "it is scaled to nothing")
    assert list(map(str, grouped(report.entries))) == [
        "skipped Box 0: it is scaled to nothing",
        "unplaced 5 (Box 4, Box 3, Box 2 and 2 more): no room for 0–4 of its 9 instances"]


def test_few_numbers_are_said_one_by_one_and_equal_sentences_once():
    report = Report()
    for name, count in (("Ball", 12), ("Cone", 16), ("Cube", 12)):
        report.approximated(name, f"simplified from 168 to {count} triangles")
    report.refused("Rock", "its transform is infinite")
    assert list(map(str, grouped(report.entries))) == [
        "refused Rock: its transform is infinite",
        "approximated 2 (Ball, Cube): simplified from 168 to 12 triangles",
        "approximated Cone: simplified from 168 to 16 triangles"]


def test_of_many_simplified_meshes_the_largest_is_named_first_with_the_range_of_triangles():
    report = Report()
    for name, count in (("Pot", 3584), ("Tree", 90000), ("Leaf", 900), ("Rock", 12000)):
        report.approximated(name, f"simplified from {count} to {count // 100} triangles")
    assert list(map(str, grouped(report.entries))) == [
        "approximated 4 (Tree, Rock, Pot and 1 more): simplified from 900–90000 to 9–900 triangles"]


def test_numbers_of_all_forms_are_one_range():
    report = Report()
    for i, radius in enumerate((0, 0.25, 1e-05, 3, 0.1)):
        report.approximated(f"Lamp {i}", f"its radius is 0.5 instead of {radius:.3g}: estimated shadows are softer")
    assert str(grouped(report.entries)[0]).endswith(": its radius is 0.5 instead of 0–3: estimated shadows are softer")


def test_many_lamps_are_one_line(scene, converted, report):
    for i in range(120):
        light = bpy.data.lights.new(f"Lamp {i}", "POINT")
        light.shadow_soft_size = 1e-6 * i
        obj = bpy.data.objects.new(f"Lamp {i}", light)
        obj.location = i % 11, i // 11, 3
        scene.collection.objects.link(obj)
    converted()
    lines = list(map(str, grouped(report.entries)))
    assert len(report.entries) >= 120 and len(lines) <= 3
    assert any(line.startswith("approximated 120 (Lamp 119, Lamp 118, Lamp 117 and 117 more): its radius is ")
               for line in lines), lines


def test_many_instances_are_one_line(scene, converted, add_mesh, report):
    card = add_mesh("Card 0")
    for i in range(1, 300):
        obj = bpy.data.objects.new(f"Card {i}", card.data)
        obj.location, obj.scale = (i % 20, i // 20, 0), (0, 0, 0)
        scene.collection.objects.link(obj)
    far = add_mesh("Far")
    far.location.x = NAN
    converted()
    lines = list(map(str, grouped(report.entries)))
    assert lines[0].startswith("refused Far: ") and len(lines) <= 4, lines


def test_a_mesh_beyond_all_numbers_is_left_out_by_name(converted, add_mesh, report):
    add_mesh("Rock")
    far = add_mesh("Far", np.float64([(0, 0, 0), (1e14, 0, 0), (0, 1e14, 0)]))
    far.scale = 1e10, 1e10, 1e10
    assert len(converted()) == 1
    assert any(line.startswith("refused Far: ") for line in report.lines())
