# SPDX-License-Identifier: GPL-3.0-or-later
"""The Cycles reference beside our picture: what Cycles itself renders, in passes of the same result."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat, passes
from bl_ext.user_default.renderformer_v2.rf2_engine.engine import RenderFormerEngine
from bl_ext.user_default.renderformer_v2.rf2_engine.panels.reference import RENDERFORMER_PT_reference
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.reference_settings import BOUNCES, PAPER

from tests.rf2_engine.f12 import press_f12, read_exr

REFERENCE = "ViewLayer.Cycles Reference"
LIGHT = {p.blender_name for p in passes.REFERENCE[1:]}


def by_cycles(scene, tmp_path, samples=4, denoise=False, **more) -> dict[str, np.ndarray]:
    """What Cycles renders of the scene, by F12 with Cycles chosen."""
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", samples, denoise
    try:
        return press_f12(scene, tmp_path, **more)
    finally:
        scene.render.engine = RenderFormerEngine.bl_idname


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
@pytest.mark.parametrize("persistent", [False, True])
def test_the_reference_is_what_cycles_renders_and_our_picture_stays_what_it_was(lit, tmp_path, persistent, light):
    lit.render.use_persistent_data, lit.renderformer_v2.light = persistent, light
    lit.objects["Cube"].modifiers.new("Round", "SUBSURF")  # Cycles throws away what modifiers made after the first run
    found = press_f12(lit, tmp_path)
    again = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(found[REFERENCE], by_cycles(lit, tmp_path)["ViewLayer.Combined"])
    np.testing.assert_array_equal(again[REFERENCE], found[REFERENCE])
    lit.renderformer_v2.reference.use = False
    alone = press_f12(lit, tmp_path)
    assert set(found) == {*alone, REFERENCE}
    for name in alone:
        np.testing.assert_allclose(found[name], alone[name], rtol=1e-4, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("blurred", [False, True])
def test_particles_that_are_not_baked_are_in_both_pictures_and_stay(lit, tmp_path, blurred):
    """They fall from above and rest on the ground: in a cache of memory, which Blender empties at any edit."""
    ground = lit.objects["Cube"]
    ground.modifiers.new("Ground", "COLLISION")
    mesh = bpy.data.meshes.new("Above")
    mesh.from_pydata([(-1, -1, 2), (1, -1, 2), (0, 1, 2)], [], [(0, 1, 2)])
    above = bpy.data.objects.new("Above", mesh)
    lit.collection.objects.link(above)
    above.modifiers.new("Rain", "PARTICLE_SYSTEM")
    rain = above.particle_systems[0].settings
    rain.count, rain.frame_end, rain.lifetime, rain.render_type, rain.particle_size = 200, 1, 100, "OBJECT", 0.15
    rain.instance_object = ground
    lit.view_layers[0].update()
    for frame in range(1, 6):
        lit.frame_set(frame)
    lit.camera.data.dof.use_dof = blurred
    lit.renderformer_v2.reference.use = False
    before = by_cycles(lit, tmp_path)["ViewLayer.Combined"]
    lit.renderformer_v2.reference.use = not blurred
    for _ in range(2):
        found = press_f12(lit, tmp_path)
        if not blurred:
            np.testing.assert_array_equal(found[REFERENCE], before)
    np.testing.assert_array_equal(by_cycles(lit, tmp_path)["ViewLayer.Combined"], before)


def test_light_paths_and_samples_are_the_scenes_or_its_own(lit, tmp_path):
    lit.cycles.samples, lit.cycles.max_bounces, lit.cycles.sample_clamp_direct = 4, 3, 0.1
    chosen = lit.renderformer_v2.reference
    chosen.samples, chosen.use_scene_samples = 1, True
    as_the_scene = press_f12(lit, tmp_path)[REFERENCE]
    np.testing.assert_array_equal(as_the_scene, by_cycles(lit, tmp_path)["ViewLayer.Combined"])
    chosen.light_paths, chosen.max_bounces, chosen.clamp_indirect, chosen.use_caustics = "OWN", 0, 1.5, False
    own = press_f12(lit, tmp_path)[REFERENCE]
    assert not np.array_equal(own, as_the_scene) and lit.cycles.max_bounces == 3
    cycles = lit.cycles
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0, 1.5
    for name in BOUNCES:
        setattr(cycles, name, 0)
    np.testing.assert_array_equal(own, by_cycles(lit, tmp_path)["ViewLayer.Combined"])


def test_a_reference_as_in_the_paper_is_cycles_with_its_factory_settings(lit, tmp_path):
    """Whatever the scene has; the samples are few here."""
    cycles, factory = lit.cycles, {name: lit.cycles.bl_rna.properties[name].default for name in PAPER}
    factory |= {"caustics_reflective": True, "caustics_refractive": True}
    cycles.max_bounces, cycles.sample_clamp_indirect, cycles.use_adaptive_sampling = 0, 1, False
    cycles.volume_bounces = 9
    bpy.ops.renderformer_v2.reference_as_in_paper()
    chosen = lit.renderformer_v2.reference
    assert (chosen.use, chosen.samples, chosen.use_denoising) == (True, 4096, True)
    chosen.samples = 4
    found = press_f12(lit, tmp_path)[REFERENCE]
    for name, value in factory.items():
        setattr(cycles, name, value)
    assert cycles.volume_bounces == 0
    cycles.denoiser = "OPENIMAGEDENOISE"
    np.testing.assert_array_equal(found, by_cycles(lit, tmp_path, denoise=True)["ViewLayer.Combined"])


@pytest.mark.parametrize("transparent, exposure, denoise", [(False, 2.0, True), (True, 0.5, False)])
def test_film_and_denoiser_are_those_of_cycles(lit, tmp_path, transparent, exposure, denoise):
    lit.render.film_transparent, lit.cycles.film_exposure = transparent, exposure
    lit.renderformer_v2.reference.use_denoising = denoise
    found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(found[REFERENCE],
                                  by_cycles(lit, tmp_path, denoise=denoise)["ViewLayer.Combined"])
    background = found["ViewLayer.Combined"][0, 0]
    np.testing.assert_allclose(found[REFERENCE][0, 0], background, atol=0.05 if denoise else 1e-5)


def test_a_reference_in_tiles_is_whole(lit, tmp_path):
    lit.cycles.use_auto_tile, lit.cycles.tile_size = True, 16
    found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(found[REFERENCE], by_cycles(lit, tmp_path)["ViewLayer.Combined"])
    assert found[REFERENCE][..., 3].min() == 1


@pytest.mark.parametrize("crop", [False, True])
def test_a_border_holds_the_same_part_of_both(lit, tmp_path, crop):
    settings = lit.render
    settings.use_border, settings.use_crop_to_border = True, crop
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.21, 0.83, 0.13, 0.61
    found = press_f12(lit, tmp_path)
    reference = by_cycles(lit, tmp_path)["ViewLayer.Combined"]
    assert found[REFERENCE].shape == found["ViewLayer.Combined"].shape == reference.shape
    np.testing.assert_array_equal(found[REFERENCE], reference)


@pytest.mark.parametrize("persistent", [False, True])
def test_every_view_layer_has_its_own(lit, tmp_path, persistent):
    lit.render.use_persistent_data = persistent
    inside = bpy.data.collections.new("Inside")
    lit.collection.children.link(inside)
    inside.objects.link(lit.objects["Cube"])
    lit.collection.objects.unlink(lit.objects["Cube"])
    lit.view_layers.new("Without").layer_collection.children["Inside"].exclude = True
    found, last = press_f12(lit, tmp_path), list(last_render.last_frame)
    cycles = by_cycles(lit, tmp_path)
    for layer in ("ViewLayer", "Without"):
        np.testing.assert_array_equal(found[f"{layer}.Cycles Reference"], cycles[f"{layer}.Combined"])
    assert [layer.reference_samples for layer in last] == [4, 4]
    assert not np.array_equal(found[REFERENCE], found["Without.Cycles Reference"])


@pytest.mark.parametrize("persistent", [False, True])
def test_every_frame_of_an_animation_has_its_own(lit, tmp_path, persistent):
    moving = lit.objects["Cube"]
    moving.keyframe_insert("location", frame=1)
    moving.location.x = 0.5
    moving.keyframe_insert("location", frame=2)
    lit.frame_start, lit.frame_end, lit.render.use_persistent_data = 1, 2, persistent
    compat.set_file_format(lit.render.image_settings, "OPEN_EXR_MULTILAYER")
    lit.render.image_settings.color_depth = "32"

    def frames(name):
        lit.render.filepath = str(tmp_path / name)
        bpy.ops.render.render(animation=True, scene=lit.name)
        return [read_exr(tmp_path / f"{name}{i:04d}.exr") for i in (1, 2)]
    ours = frames("ours_")
    lit.render.engine, lit.cycles.samples, lit.cycles.use_denoising = "CYCLES", 4, False
    theirs = frames("theirs_")
    for mine, cycles in zip(ours, theirs):
        np.testing.assert_array_equal(mine[REFERENCE], cycles["ViewLayer.Combined"])
    assert not np.array_equal(ours[0][REFERENCE], ours[1][REFERENCE])


def test_depth_of_field_and_the_light_of_hidden_settings_are_back_for_the_reference(lit, tmp_path):
    """First hits are seen by a pinhole, and without any light here."""
    lit.renderformer_v2.light = "NETWORK"
    lit.camera.data.dof.use_dof, lit.camera.data.dof.focus_distance, lit.camera.data.dof.aperture_fstop = True, 2, 0.2
    found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(found[REFERENCE], by_cycles(lit, tmp_path)["ViewLayer.Combined"])
    assert lit.camera.data.dof.use_dof and lit.objects["Cube"].visible_shadow


@pytest.mark.parametrize("persistent", [False, True])
def test_motion_blur_is_that_of_cycles_though_other_frames_change_the_scene(lit, tmp_path, persistent):
    lit.render.use_persistent_data, lit.render.use_motion_blur = persistent, True
    moving = lit.objects["Cube"]
    for frame in (0, 1, 2):
        moving.location.x = frame
        moving.keyframe_insert("location", frame=frame)
    lit.frame_set(1)

    def change(scene, depsgraph):
        scene.cycles.blur_glossy, scene.cycles["of no use"] = scene.frame_current, list(range(scene.frame_current))
    bpy.app.handlers.frame_change_pre.append(change)
    try:
        found, cycles = press_f12(lit, tmp_path), by_cycles(lit, tmp_path)
    finally:
        bpy.app.handlers.frame_change_pre.remove(change)
    np.testing.assert_array_equal(found[REFERENCE], cycles["ViewLayer.Combined"])
    lit.render.use_motion_blur = False
    assert not np.array_equal(press_f12(lit, tmp_path)[REFERENCE], found[REFERENCE])


def test_light_passes_are_those_of_cycles(lit, tmp_path):
    lit.renderformer_v2.reference.use_light_passes = True
    found = press_f12(lit, tmp_path)
    lit.view_layers[0].use_pass_diffuse_direct = lit.view_layers[0].use_pass_glossy_indirect = True
    theirs = by_cycles(lit, tmp_path)
    assert {f"ViewLayer.{name}" for name in LIGHT} <= set(found)
    for p in passes.PASSES:
        if p.key in ("diffuse_direct", "glossy_indirect"):
            np.testing.assert_array_equal(found[f"ViewLayer.Cycles {p.name_5}"], theirs[f"ViewLayer.{p.blender_name}"])
    assert found["ViewLayer.Cycles Diffuse Direct"].max() > 0.1


def test_cycles_knows_all_passes_of_the_result(lit, tmp_path, capfd):
    """It prints an error for each that it does not know."""
    lit.renderformer_v2.reference.use_light_passes = lit.render.use_motion_blur = True
    for lit.render.use_persistent_data in (False, True, True):
        press_f12(lit, tmp_path)
    assert "Unknown pass" not in "".join(capfd.readouterr()) and not lit.view_layers[0].aovs


def test_the_compositor_has_the_sockets_before_the_first_render(scene):
    layers = compositor_input(scene)
    chosen, names = scene.renderformer_v2.reference, lambda: {s.name for s in layers.outputs if s.enabled}
    assert "Cycles Reference" not in names()
    chosen.use = True
    assert "Cycles Reference" in names() and not names() & LIGHT
    chosen.use_light_passes = True
    assert names() >= LIGHT
    chosen.use = False
    assert not names() & (LIGHT | {"Cycles Reference"})


def compositor_input(scene):
    if hasattr(scene, "compositing_node_group"):
        scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        return scene.compositing_node_group.nodes.new("CompositorNodeRLayers")
    scene.use_nodes = True
    return next(node for node in scene.node_tree.nodes if node.type == "R_LAYERS")


def test_every_setting_has_its_place_in_the_panel(scene):
    settings, drawn = scene.renderformer_v2.reference, set()
    settings.light_paths = "OWN"

    class Layout:
        def column(self):
            return self

        def prop(self, owner, name, **options):
            assert name in owner.bl_rna.properties
            drawn.add(name)

        def operator(self, name, **options):
            assert name == "renderformer_v2.reference_as_in_paper"

    panel = type("Panel", (), {"layout": Layout(), "split_layout": lambda self: self.layout})()
    RENDERFORMER_PT_reference.draw_header(panel, bpy.context)
    RENDERFORMER_PT_reference.draw(panel, bpy.context)
    assert drawn >= set(settings.__annotations__) | {"device"}
