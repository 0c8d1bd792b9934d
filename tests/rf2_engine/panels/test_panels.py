# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that acts has its place in the interface; what does not act is left out, or greyed with the reason."""
import types
from pathlib import Path

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.model.weights import presets
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import blender_panels, camera, render_settings

from tests.rf2_engine.f12 import cube, sun
from tests.rf2_engine.layout import Layout


def drawn(scene, panel, **context) -> Layout:
    context = types.SimpleNamespace(**{
        "engine": scene.render.engine, "scene": scene, "view_layer": scene.view_layers[0],
        "camera": scene.camera.data, "object": scene.camera, "light": None, "world": scene.world, "material": None,
        "preferences": bpy.context.preferences, "region": None} | context)
    assert panel.poll(context), panel
    layout = Layout()
    stand_in = types.SimpleNamespace(layout=layout, split_layout=lambda: layout, bl_space_type="PROPERTIES")
    for method in ("draw_header", "draw"):
        if draw := getattr(panel, method, None):
            draw(stand_in, context)
    return layout


def panels():
    return {name: getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("RENDERFORMER_")}


@pytest.mark.parametrize("panel, expected", [
    ("RENDERFORMER_PT_settings", {"weights_source", "device", "precision", "light", "token_budget", "max_edge"}),
    ("RENDERFORMER_PT_sampling", {"guide_samples", "use_adaptive_sampling", "adaptive_threshold",
                                  "adaptive_min_samples"}),
    ("RENDERFORMER_PT_film", {"film_exposure", "film_transparent", "film_transparent_glass", "pixel_filter_type",
                              "filter_width"}),
    ("RENDERFORMER_PT_depth_of_field", {"lens_samples"}),
    ("RENDERFORMER_CAMERA_PT_dof", {"use_dof", "focus_object", "focus_distance", "lens_samples"}),
    ("RENDERFORMER_CAMERA_PT_dof_aperture", {"aperture_fstop", "aperture_blades", "aperture_ratio"}),
    ("RENDERFORMER_PT_motion_blur", {"use_motion_blur", "shutter_samples", "motion_blur_position",
                                     "motion_blur_shutter"}),
    ("RENDERFORMER_PT_performance", {"threads_mode", "threads", "use_persistent_data"}),
    ("RENDERFORMER_PT_passes_data", {"use_pass_z", "use_pass_mist", "pass_alpha_threshold"}),
    ("RENDERFORMER_PT_override", {"material_override", "world_override", "samples"}),
    ("RENDERFORMER_OBJECT_PT_visibility", {"hide_render", "is_shadow_catcher", "is_holdout"}),
    ("RENDERFORMER_OBJECT_PT_visibility_ray_visibility", {"visible_camera", "visible_diffuse", "visible_shadow"}),
    ("RENDERFORMER_WORLD_PT_ray_visibility", {"camera", "diffuse", "glossy"}),
    ("RENDERFORMER_WORLD_PT_settings_surface", {"sampling_method", "max_bounces"}),
    ("RENDERFORMER_PT_light_paths", {"max_bounces", "glossy_bounces", "transmission_bounces", "sample_clamp_direct",
                                     "sample_clamp_indirect", "blur_glossy", "transparent_max_bounces",
                                     "caustics_reflective", "caustics_refractive"}),
])
def test_what_acts_can_be_set(scene, panel, expected):
    assert expected <= drawn(scene, panels()[panel], object=cube(scene)).shown


def test_sampling_stands_below_the_settings_of_the_engine_as_in_cycles():
    ours = [name for name in render_settings.__dict__ if name.startswith("RENDERFORMER_PT_")]
    at_the_top = [name for name in ours if not hasattr(panels().get(name), "bl_parent_id")
                  and panels()[name].bl_label != "RenderFormer-V2 Presets"]
    assert [panels()[name].bl_label for name in at_the_top][:2] == ["RenderFormer-V2", "Sampling"]


@pytest.mark.parametrize("name", ["RENDERFORMER_PT_settings", "RENDERFORMER_PT_passes_data",
                                  "RENDERFORMER_PT_material_settings"])
def test_labels_are_in_blenders_column(scene, name):
    layout = drawn(scene, panels()[name], material=cube(scene).active_material)
    assert layout.use_property_split is not False


@pytest.mark.parametrize("size, changes, acts", [
    (512, {}, False), (128, {}, True), (512, {"guide_samples": 32}, True), (128, {"light": "NETWORK"}, False),
    (512, {"shutter_samples": 3}, True)])  # the whole blurred picture has 8 samples for each moment
def test_noise_threshold_is_greyed_out_where_it_cannot_act(scene, size, changes, acts):
    scene.renderformer_v2.guide_samples, scene.renderformer_v2.use_adaptive_sampling = 0, True
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.use_motion_blur = "shutter_samples" in changes
    for name, value in changes.items():
        setattr(scene.renderformer_v2, name, value)
    layouts = []

    class Part(Layout):
        def __init__(self):
            super().__init__()
            layouts.append(self)

        def row(self, **_):
            return Part()

        column = row

    panel = panels()["RENDERFORMER_PT_sampling"]
    panel.draw(types.SimpleNamespace(split_layout=Part),
               types.SimpleNamespace(scene=scene, view_layer=scene.view_layers[0]))
    active = {name: layout.active for layout in layouts for name in layout.shown}
    assert active["guide_samples"] and active["use_adaptive_sampling"] == acts == active["adaptive_min_samples"]


def test_automatic_threads_show_how_many_blender_takes(scene):
    panel, shown = panels()["RENDERFORMER_PT_performance"], []

    class Recorder(Layout):
        def prop(self, data, name, **options):
            super().prop(data, name, **options)
            shown.append((name, getattr(data, name), self.enabled))

    def threads():
        shown.clear()
        context = types.SimpleNamespace(scene=scene)
        panel.draw(types.SimpleNamespace(split_layout=Recorder), context)
        return next((value, enabled) for name, value, enabled in shown if name == "threads")

    scene.render.threads_mode, scene.render.threads = "FIXED", 3
    assert threads() == (3, False)
    scene.renderformer_v2.threads_mode, scene.renderformer_v2.threads = "FIXED", 5
    assert threads() == (5, True)


def test_passes_that_cannot_be_given_are_named(scene):
    light = panels()["RENDERFORMER_PT_passes_light"]
    assert not drawn(scene, light).texts
    scene.renderformer_v2.light = "NETWORK"
    scene.view_layers[0].cycles.use_pass_shadow_catcher = True
    assert "Shadow Catcher" in " ".join(drawn(scene, light).texts)


def test_a_material_has_its_settings(scene):
    shown = drawn(scene, panels()["RENDERFORMER_PT_material_settings"], material=cube(scene).active_material).shown
    assert {"pass_index", "displacement_method", "use_transparent_shadow"} <= shown


def test_light_linking_and_the_shadow_terminator_have_their_place():
    for name in ("OBJECT_PT_shading", "OBJECT_PT_shadow_terminator"):
        assert "RENDERFORMER_V2" in getattr(bpy.types, name).COMPAT_ENGINES, name


def test_light_groups_can_be_chosen_and_mixed(scene):
    for name in ("RENDERFORMER_OBJECT_PT_lightgroup", "RENDERFORMER_WORLD_PT_settings_light_group",
                 "RENDERFORMER_PT_passes_lightgroups"):
        assert len(drawn(scene, panels()[name], object=cube(scene)).operators) >= 1, name


def test_what_acts_on_traced_light_alone_says_so(scene):
    scene.renderformer_v2.light = "NETWORK"
    assert "only Transparent and Caustics act" in " ".join(drawn(scene, panels()["RENDERFORMER_PT_light_paths"]).texts)
    context = types.SimpleNamespace(engine="RENDERFORMER_V2", world=scene.world, scene=scene)
    assert not panels()["RENDERFORMER_WORLD_PT_settings_surface"].poll(context)


def test_an_area_lamp_has_its_spread(scene):
    lamp = bpy.data.lights.new("Area", "AREA")
    assert {"energy", "shape", "size"} <= drawn(scene, panels()["RENDERFORMER_LIGHT_PT_light"], light=lamp).shown
    assert {"is_portal", "use_shadow"} <= drawn(scene, panels()["RENDERFORMER_LIGHT_PT_settings"], light=lamp).shown
    assert "spread" in drawn(scene, panels()["RENDERFORMER_LIGHT_PT_beam_shape"], light=lamp).shown
    assert panels()["RENDERFORMER_LIGHT_PT_nodes"].bl_label == "Nodes"


def test_a_sun_has_no_beam(scene):
    context = types.SimpleNamespace(engine="RENDERFORMER_V2", light=sun(scene).data)
    assert not panels()["RENDERFORMER_LIGHT_PT_beam_shape"].poll(context)


@pytest.mark.parametrize("panel, switch", [("RENDERFORMER_CAMERA_PT_dof", "lens_samples"),
                                           ("RENDERFORMER_PT_motion_blur", "shutter_samples")])
def test_blur_that_is_wanted_and_has_one_sample_says_so(scene, panel, switch):
    scene.camera.data.dof.use_dof = scene.render.use_motion_blur = True
    assert not drawn(scene, panels()[panel]).texts
    setattr(scene.renderformer_v2, switch, 1)
    assert "Samples above 1" in " ".join(drawn(scene, panels()[panel]).texts)
    setattr(scene.renderformer_v2, switch, 8)
    assert not drawn(scene, panels()[panel]).texts


def test_a_folder_without_weights_is_warned_of_below_its_name(scene, tmp_path):
    settings = scene.renderformer_v2
    settings.weights_source, settings.weights_folder = "FOLDER", str(tmp_path)
    assert "holds no weights" in " ".join(drawn(scene, panels()["RENDERFORMER_PT_settings"]).texts)
    settings.weights_folder = str(Path(presets.__file__).parent / presets.BUNDLED)
    assert "weights" not in " ".join(drawn(scene, panels()["RENDERFORMER_PT_settings"]).texts)


def test_each_network_has_its_own_settings(scene, tmp_path):
    settings, of_published = scene.renderformer_v2, {"transformer", "paper_lamps"}

    def shown():
        return drawn(scene, panels()["RENDERFORMER_PT_settings"]).shown & (of_published | {"light"})
    assert shown() == {"light"}
    settings.weights_source = "FOLDER"
    assert shown() == {"light"}  # no folder is chosen yet
    (tmp_path / "model_index.json").write_text("{}")
    settings.weights_folder = str(tmp_path)
    assert shown() == of_published
    settings.weights_source = "PUBLISHED"
    assert shown() == of_published


def test_transparent_glass_that_the_light_does_not_give_says_so(scene):
    def texts():
        return " ".join(drawn(scene, panels()["RENDERFORMER_PT_film"]).texts)
    settings = scene.renderformer_v2
    settings.light = "NETWORK"
    assert "Transparent Glass" not in texts()  # the film is opaque
    scene.render.film_transparent = True
    assert "needs the bundled network, and Light: With Cycles" in texts()
    settings.light = "TRACED"
    assert "Transparent Glass" not in texts()


def lens_of(scene):
    layout = Layout()
    context = types.SimpleNamespace(engine="RENDERFORMER_V2", camera=scene.camera.data)
    camera.draw_lens(types.SimpleNamespace(layout=layout), context)
    return layout


def test_a_panoramic_camera_has_the_settings_that_cycles_gives_it(scene):
    data = scene.camera.data
    assert not lens_of(scene).shown and not lens_of(scene).texts
    data.type = "PANO"
    for kind in data.bl_rna.properties["panorama_type"].enum_items.keys():
        data.panorama_type = kind
        assert "panorama_type" in lens_of(scene).shown and not lens_of(scene).texts
    data.panorama_type = "EQUIRECTANGULAR"
    assert {"latitude_min", "longitude_max"} <= lens_of(scene).shown


def test_a_camera_of_a_type_that_is_not_supported_is_warned_of_beside_its_lens(scene):
    scene.camera.data.type = "CUSTOM"
    assert "Perspective" in " ".join(lens_of(scene).texts)


def test_other_engines_keep_their_panels_to_themselves(scene):
    context = types.SimpleNamespace(engine="CYCLES", light=sun(scene).data, object=scene.camera, world=scene.world)
    assert not any(panel.poll(context) for panel in blender_panels.registered_copies)
    simplify = bpy.types.RENDER_PT_simplify
    assert "RENDERFORMER_V2" not in simplify.COMPAT_ENGINES and "BLENDER_RENDER" in simplify.COMPAT_ENGINES


def test_a_latent_is_offered_where_the_weights_know_it_or_the_material_has_one(scene):
    panel, material = panels()["RENDERFORMER_PT_material_latent"], cube(scene).active_material
    context = types.SimpleNamespace(engine="RENDERFORMER_V2", scene=scene, material=material)
    assert not panel.poll(context)
    material.renderformer_v2.use_latent = True
    assert "Only published weights" in " ".join(drawn(scene, panel, material=material).texts)
    scene.renderformer_v2.weights_source, material.renderformer_v2.use_latent = "PUBLISHED", False
    assert not drawn(scene, panel, material=material).texts
