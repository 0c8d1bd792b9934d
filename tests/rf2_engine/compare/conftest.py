# SPDX-License-Identifier: GPL-3.0-or-later
"""Two slots that Cycles rendered: a grey world in the first, a brighter one and a cube in the second."""
import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat

from tests.rf2_engine.f12 import cube, sun


@pytest.fixture
def two_slots(scene):
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.view_layers[0].use_pass_z = True
    scene.view_layers[0].use_pass_normal = True
    slots = bpy.data.images["Render Result"].render_slots if "Render Result" in bpy.data.images else None
    if slots is None:
        bpy.ops.render.render()
        slots = bpy.data.images["Render Result"].render_slots
    slots.active_index = 0
    bpy.ops.render.render()
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.6, 0.7, 1)
    cube(scene), sun(scene)
    slots.active_index = 1
    bpy.ops.render.render()
    yield scene
    for image in bpy.data.images:
        if image.type == "RENDER_RESULT":
            image.render_slots.active_index = 0


@pytest.fixture
def settings(two_slots):
    """A is the first slot, B the second."""
    chosen = bpy.context.window_manager.renderformer_v2_compare
    chosen.a.kind = chosen.b.kind = "SLOT"
    chosen.a.slot, chosen.b.slot = 1, 2
    for side in (chosen.a, chosen.b):
        side.layer, side.pass_name, side.image = "", "Combined", ""
    chosen.region, chosen.show = "WHOLE", True
    yield chosen
    bpy.context.window_manager.renderformer_v2_compare.show = False  # another file has another window manager


@pytest.fixture
def save_exr(two_slots, tmp_path):
    def save(name: str, codec: str):
        path = tmp_path / name
        compat.set_file_format(two_slots.render.image_settings, "OPEN_EXR_MULTILAYER")
        two_slots.render.image_settings.color_depth = "32"
        two_slots.render.image_settings.exr_codec = codec
        bpy.data.images["Render Result"].save_render(str(path), scene=two_slots)
        return path

    return save
