# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds that Cycles has to evaluate: what the tokens say of them against Cycles' irradiance."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import world as world_session
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles.fingerprint import describe_world
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.convert.cycles_reference import irradiance
from tests.rf2_engine.convert.lamps.test_suns import light
from tests.rf2_engine.convert.worlds import sky_world
from tests.rf2_engine.f12 import cube, press_f12, read_exr

NORMALS = (0, 0, 1), (1, 0.3, 0.2)


@pytest.fixture
def tokens(scene, monkeypatch):
    """Function that presses F12 and gives the tokens; its `found` are the first hits of the last time."""
    seen = []

    def record(found, tokens, view):
        seen.append(tokens)
        run.found = found
        raise RenderCancelled  # the network has nothing to do with it

    def run():
        monkeypatch.setattr(first_hits, "make_guides", record)
        bpy.ops.render.render(scene=scene.name)
        return seen.pop()
    return run


def measured(scene):
    """(n, 3) irradiance in Cycles' picture, of NORMALS."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 1024, False, 0
    scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    for obj in list(scene.objects):
        bpy.data.objects.remove(obj)
    return np.array([irradiance((0, 0, 0), normal) for normal in NORMALS])


KINDS = [name for name in ("NISHITA", "SINGLE_SCATTERING", "MULTIPLE_SCATTERING", "PREETHAM", "HOSEK_WILKIE")
         if name in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items.keys()]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sky_gives_the_light_that_it_gives_in_cycles(scene, tokens, kind):
    cube(scene)
    sky_world(0.5, disc=True, size=0.02, kind=(kind,))
    scene_tokens = tokens()
    found = np.array([light(scene_tokens, normal) for normal in NORMALS])
    np.testing.assert_allclose(found, measured(scene), rtol=0.02)


def test_a_world_is_drawn_as_it_lights_and_nothing_of_the_scene_changes(scene, tokens):
    """Light Path in a group, a turned sky, a node of the camera's, a shutter, and fog that the light does not see."""
    cube(scene).modifiers.new("Subdivision", "SUBSURF").render_levels = 2
    tokens()
    depth = tokens.found["depth"]
    made = sky_world(0.5, kind=("PREETHAM",))
    tree = made.node_tree
    names = ("MixShader", "Background", "LayerWeight", "Math", "Group")
    mix, green, weight, half, group = (tree.nodes.new(f"ShaderNode{name}") for name in names)
    green.inputs["Color"].default_value = (0, 50, 0, 1)
    half.operation, half.inputs[1].default_value = "ADD", 0.5
    group.node_tree = bpy.data.node_groups.new("Rays", "ShaderNodeTree")
    group.node_tree.interface.new_socket("Camera", in_out="OUTPUT", socket_type="NodeSocketFloat")
    inner = group.node_tree.nodes
    group.node_tree.links.new(inner.new("ShaderNodeLightPath").outputs["Is Camera Ray"],
                              inner.new("NodeGroupOutput").inputs[0])
    sky, background = tree.nodes["Sky Texture"], tree.nodes["Background"]
    output = next(node for node in tree.nodes if node.type == "OUTPUT_WORLD")
    for start, end in ((group.outputs[0], mix.inputs[0]), (background.outputs[0], mix.inputs[1]),
                       (green.outputs[0], mix.inputs[2]), (mix.outputs[0], output.inputs["Surface"]),
                       (weight.outputs["Facing"], half.inputs[0]), (half.outputs[0], background.inputs["Strength"])):
        tree.links.new(start, end)
    scene.render.use_motion_blur = scene.camera.data.dof.use_dof = True
    scene.renderformer_v2.lens_samples = scene.renderformer_v2.shutter_samples = 1  # a sharp picture all the same
    bpy.context.view_layer.update()
    before = describe_world(made), of_tree_links(made), scene.camera.matrix_world.copy(), scene.camera.data.type
    scene_tokens = tokens()
    assert len(scene_tokens) == 2 * 24 * 4
    np.testing.assert_array_equal(tokens.found["depth"], depth)
    np.testing.assert_allclose(tokens.found["environment"][0, 0], (0, 50, 0), rtol=1e-3)  # what the camera sees
    assert before == (describe_world(made), of_tree_links(made), scene.camera.matrix_world, scene.camera.data.type)
    assert scene.camera.data.dof.use_dof and scene.camera.visible_camera and sky.sky_type == "PREETHAM"
    found = np.array([light(scene_tokens, normal) for normal in NORMALS])
    np.testing.assert_allclose(found, measured(scene), rtol=0.02)


def of_tree_links(world):
    return [link.is_muted for link in world.node_tree.links]


def test_esc_while_a_world_is_drawn_leaves_nothing_of_it(scene, monkeypatch, tmp_path):
    cube(scene)
    sky_world(0.5, kind=("PREETHAM",))
    real, stopped = world_session.CyclesWorld._draw, []

    def drawn(self, *arguments, **named):
        real(self, *arguments, **named)
        stopped.append(True)
        raise RenderCancelled

    monkeypatch.setattr(world_session.CyclesWorld, "_draw", drawn)
    passes = press_f12(scene, tmp_path)
    assert stopped and last_render.last_frame[-1].cancelled
    assert not passes["ViewLayer.Combined"].any()


def test_a_picture_of_one_pixel_has_the_sun(scene, tokens):
    cube(scene)
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.resolution_percentage = 25
    sky_world(0.5, disc=True, size=0.02)
    assert light(tokens(), (0, 0, 1)).min() > 20  # without a sun it is about 5


def test_with_a_render_border_the_sky_is_that_of_the_whole_picture(scene, tokens):
    scene.camera.constraints.new("TRACK_TO").target = cube(scene)
    sky_world(0.5, disc=True, size=0.02)
    whole = tokens()
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x, scene.render.border_max_y = 0.5, 0.7, 0.4
    part = tokens()
    assert tokens.found["depth"].size < scene.render.resolution_x * scene.render.resolution_y / 4
    np.testing.assert_allclose(part.environment, whole.environment, rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(light(part, (0, 0, 1)), light(whole, (0, 0, 1)), rtol=0.01)


def test_in_an_animation_the_sky_is_that_of_each_frame(scene, tmp_path):
    tree = sky_world(0.3, kind=("PREETHAM",)).node_tree
    for frame, turbidity in ((1, 1.7), (2, 9.0)):
        tree.nodes["Sky Texture"].turbidity = turbidity
        tree.keyframe_insert('nodes["Sky Texture"].turbidity', frame=frame)
    scene.frame_set(2)
    expected = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    scene.frame_set(1)
    scene.render.filepath, scene.frame_end = str(tmp_path / "#"), 2
    bpy.ops.render.render(scene=scene.name, animation=True)
    np.testing.assert_allclose(read_exr(tmp_path / "2.exr")["ViewLayer.Combined"], expected, rtol=0.02)


@pytest.mark.parametrize("where", ["_resize", "_isolate"])
def test_a_fault_of_ours_while_a_world_is_drawn_is_no_failure_of_cycles(scene, monkeypatch, where):
    def faulty(*_):
        raise TypeError("a fault of ours")

    cube(scene)
    sky_world(0.5, kind=("PREETHAM",))
    monkeypatch.setattr(world_session, where, faulty)
    with pytest.raises(RuntimeError, match="a fault of ours"):
        bpy.ops.render.render(scene=scene.name)
    assert "Internal error" in last_render.last_frame[0].error


def test_where_cycles_cannot_draw_a_world_the_render_goes_on(scene, monkeypatch, tmp_path):
    import cycles.engine
    real, calls = cycles.engine.reset, []

    def reset(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise TypeError("other parameters")
        real(*arguments)

    cube(scene)
    sky_world(0.5, kind=("PREETHAM",))
    monkeypatch.setattr(cycles.engine, "reset", reset)
    press_f12(scene, tmp_path)
    assert len(calls) == 2 and last_render.last_frame[0].device
    assert any("Sky Texture" in line for line in last_render.last_frame[0].report)
