# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of field and motion blur: those of Cycles, as the mean of samples that share whatever has not moved."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import shutter
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.optics import Optics
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache
from bl_ext.user_default.renderformer_v2.rf2_engine.sampling import Sampling

from tests.rf2_engine.convert.camera.test_camera import project
from tests.rf2_engine.f12 import cube, material, press_f12, sun
from tests.rf2_engine.still_life import tick, tick_own

SAMPLES = 8
SIZE = 40


@pytest.fixture
def blurry(scene):
    """A red cube in the sun, at the first frame but one."""
    cube(scene, of=material("Red", (0.8, 0.3, 0.2))).rotation_euler = (0.3, 0.2, 0.5)
    sun(scene)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.renderformer_v2.guide_samples = 4
    scene.render.motion_blur_shutter = 1
    scene.frame_set(2)
    return scene


def focused(scene, near, **dof):
    lens = scene.camera.data.dof
    lens.use_dof, lens.focus_distance, lens.aperture_fstop = True, near, 0.1
    for name, value in dof.items():
        setattr(lens, name, value)
    scene.renderformer_v2.lens_samples = SAMPLES


def moving(scene, obj, *places):
    """Past these places at frames 1, 2, ..., motion blurred."""
    for frame, place in enumerate(places, 1):
        obj.location = place
        obj.keyframe_insert("location", frame=frame)
    scene.frame_set(2)
    scene.render.use_motion_blur, scene.renderformer_v2.shutter_samples = True, SAMPLES


def with_cycles(scene, tmp_path, samples=64):
    scene.render.engine, scene.cycles.samples = "CYCLES", samples
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    found = press_f12(scene, tmp_path)
    scene.render.engine = "RENDERFORMER_V2"
    return found


def assert_blurred_like_cycles(scene, tmp_path, of_sharp=0.4):
    """Combined is nearer to Cycles' than without blur, by this factor."""
    found = press_f12(scene, tmp_path)
    assert not last_render.last_frame[0].error
    expected = with_cycles(scene, tmp_path)["ViewLayer.Combined"]
    settings = scene.renderformer_v2
    settings.lens_samples = settings.shutter_samples = 1
    sharp = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    off = [np.abs(picture - expected).mean() for picture in (found["ViewLayer.Combined"], sharp)]
    assert off[0] < of_sharp * off[1]
    return found


@pytest.fixture
def seen(monkeypatch):
    """Lists of what every sample had: passes of Cycles, scene, view; scenes that were encoded."""
    found = {"samples": [], "encoded": []}

    def make_guides(*arguments, real=first_hits.make_guides):
        found["samples"].append(arguments)
        return real(*arguments)

    def encoded(renderer, scene, size, real=model_cache.encoded):
        found["encoded"].append(scene)
        return real(renderer, scene, size)
    monkeypatch.setattr(first_hits, "make_guides", make_guides)
    monkeypatch.setattr(model_cache, "encoded", encoded)
    return found


def perspective(scene):
    focused(scene, 2, aperture_blades=5, aperture_rotation=0.4, aperture_ratio=2)
    scene.camera.data.shift_x, scene.camera.data.sensor_fit, scene.render.pixel_aspect_y = 0.1, "VERTICAL", 1.5
    scene.camera.scale = (-1, 2, 1)


def orthographic(scene):
    focused(scene, 2, aperture_fstop=2, aperture_blades=3)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 5


def on_an_object(scene):
    focused(scene, 50, focus_object=bpy.data.objects["Sun"])
    bpy.data.objects["Sun"].location = (3, -2.5, 1)


@pytest.mark.parametrize("lens, light", [(perspective, "TRACED"), (orthographic, "TRACED"), (on_an_object, "NETWORK")])
def test_depth_of_field_is_that_of_cycles(blurry, tmp_path, seen, lens, light):
    blurry.renderformer_v2.light = light
    lens(blurry)
    assert_blurred_like_cycles(blurry, tmp_path, 0.52 if light == "TRACED" else 1.0)
    assert len(seen["samples"]) == SAMPLES + 1 and len(seen["encoded"]) == 2  # the last for the sharp picture
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    for found, _, view in seen["samples"]:  # Cycles looks where the network does
        hit = found["depth"][..., 0] < 1e5
        pixels = np.array([project(view, point) for point in found["position"][hit]])
        assert np.abs(pixels - np.stack([x[hit], y[hit]], -1)).max() < (0.5 if lens is orthographic else 0.05)


def test_a_bright_point_out_of_focus_is_a_disk_as_large_as_that_of_cycles(blurry, tmp_path):
    blurry.render.resolution_x = blurry.render.resolution_y = 64
    blurry.renderformer_v2.guide_samples = 32
    bpy.data.objects["Cube"].scale = (0.05, 0.05, 0.05)
    shining = material("Shining")
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 100
    bpy.data.objects["Cube"].active_material = shining
    focused(blurry, 2.5)
    radii = []
    for pictures in press_f12(blurry, tmp_path), with_cycles(blurry, tmp_path, 256):
        light = np.maximum(pictures["ViewLayer.Combined"][..., :3].mean(-1) - 0.3, 0)
        y, x = np.indices(light.shape)
        middle = np.array([(light * y).sum(), (light * x).sum()]) / light.sum()
        radii.append(np.sqrt((light * ((y - middle[0]) ** 2 + (x - middle[1]) ** 2)).sum() / light.sum()))
    assert radii[0] == pytest.approx(radii[1], rel=0.05) and radii[1] > 3


def test_a_moving_object_is_blurred_as_in_cycles(blurry, tmp_path, seen):
    blurry.render.motion_blur_position = "START"
    moving(blurry, bpy.data.objects["Cube"], (-1, 0, 0), (0, 0, 0), (1, 0, 0))
    assert_blurred_like_cycles(blurry, tmp_path)
    assert len(seen["encoded"]) == SAMPLES + 1 and blurry.frame_current_final == 2


def test_a_stretched_time_line_changes_no_moment_of_an_exposure(blurry):
    """Blender evaluates a frame at its stretched time by itself."""
    before = shutter.moments(blurry, SAMPLES)
    blurry.render.frame_map_new = 50
    np.testing.assert_array_equal(shutter.moments(blurry, SAMPLES), before)
    assert before.min() > 1 and before.max() < 3


def test_a_moving_camera_costs_no_second_scene(blurry, tmp_path, seen):
    focused(blurry, 2)
    moving(blurry, blurry.camera, (-0.5, -5, 0), (0, -5, 0), (0.5, -5, 0.4))
    blurry.render.use_border = True
    blurry.render.border_min_x, blurry.render.border_max_x = 0.2, 0.7
    blurry.renderformer_v2.shutter_samples = 3
    assert_blurred_like_cycles(blurry, tmp_path)
    assert len(seen["samples"]) == SAMPLES + 1 and len(seen["encoded"]) == 2
    assert len({view.camera_to_world.tobytes() for *_, view in seen["samples"][:SAMPLES]}) == SAMPLES


@pytest.mark.slow
def test_the_timeline_stays_where_it_is_while_other_moments_are_rendered(blurry, tmp_path, monkeypatch):
    moving(blurry, bpy.data.objects["Cube"], (-1, 0, 0), (0, 0, 0), (1, 0, 0))
    shown, evaluated = [], []

    def look(layer, *given, real=first_hits._run_session):
        shown.append(blurry.frame_current_final)
        evaluated.append(layer.depsgraph.scene_eval.frame_current_final)
        return real(layer, *given)
    monkeypatch.setattr(first_hits, "_run_session", look)
    press_f12(blurry, tmp_path)
    assert set(shown) == {2.0} and len(set(evaluated)) == SAMPLES + 1 and blurry.frame_current_final == 2


def test_where_nothing_moves_there_is_one_sample(blurry, tmp_path, seen):
    blurry.render.use_motion_blur, blurry.renderformer_v2.shutter_samples = True, SAMPLES
    press_f12(blurry, tmp_path)
    assert len(seen["samples"]) == len(seen["encoded"]) == 1


def test_passes_are_those_of_cycles_and_light_passes_make_the_picture(still_life, tmp_path):
    view_layer = still_life.view_layers[0]
    tick(view_layer, {p.key for p in passes.PASSES})
    tick_own(view_layer)
    view_layer.use_pass_vector = False  # Cycles has none with motion blur
    focused(still_life, 3, aperture_fstop=1)
    still_life.renderformer_v2.lens_samples = still_life.renderformer_v2.shutter_samples = 2
    still_life.render.use_motion_blur, still_life.renderformer_v2.light = True, "TRACED"
    ours = press_f12(still_life, tmp_path)
    cycles = with_cycles(still_life, tmp_path, still_life.renderformer_v2.guide_samples)
    computed = {f"ViewLayer.{p.blender_name}" for p in passes.PASSES if p.source in ("network", "lighting")}
    assert set(ours) - {"ViewLayer.Noisy Image"} == set(cycles)
    denoised = {f"ViewLayer.{p.blender_name}" for p in passes.PASSES if p.key in ("emission", "environment")}
    for name in set(cycles) - computed - denoised:
        same = np.isclose(ours[name], cycles[name], rtol=1e-4, atol=1e-5).all(-1)
        assert same.mean() > 0.999, name
    named = {p.key: ours[f"ViewLayer.{p.blender_name}"] for p in passes.PASSES if p.key != "vector"}
    lobes = sum(named[f"{lobe}_color"] * (named[f"{lobe}_direct"] + named[f"{lobe}_indirect"])
                for lobe in ("diffuse", "glossy", "transmission"))
    recipe = lobes + sum(named[key] for key in ("volume_direct", "volume_indirect", "emission", "environment"))
    np.testing.assert_allclose(recipe, ours["ViewLayer.Combined"][..., :3], atol=2e-3)


def test_the_world_behind_blurred_edges_is_denoised_with_them(blurry, tmp_path):
    focused(blurry, 2)
    blurry.renderformer_v2.lens_samples = 2
    blurry.view_layers[0].use_pass_environment = True
    blurry.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 20
    seen = next(f"ViewLayer.{p.blender_name}" for p in passes.PASSES if p.key == "environment")
    ours, cycles = press_f12(blurry, tmp_path), with_cycles(blurry, tmp_path, samples=256)
    picture, world = (np.abs(ours[name][..., :3] - cycles[name][..., :3]).mean(-1)
                      for name in ("ViewLayer.Combined", seen))
    is_soft = world > 0.02 * cycles[seen].max()
    assert is_soft.mean() > 0.1 and picture[is_soft].mean() < 0.5 * world[is_soft].mean()


def test_esc_between_samples_leaves_the_traced_light_and_the_frame_where_it_was(blurry, tmp_path, monkeypatch):
    moving(blurry, bpy.data.objects["Cube"], (-1, 0, 0), (0, 0, 0), (1, 0, 0))
    monkeypatch.setattr(Status, "esc_pressed", lambda status: status.sample == f"Sample 3 of {SAMPLES}")
    found = press_f12(blurry, tmp_path, may_fail=True)
    assert last_render.last_frame[0].cancelled and blurry.frame_current_final == 2
    assert found["ViewLayer.Combined"].any() and found["ViewLayer.Normal"].any()


def test_the_switches_of_camera_and_scene_are_followed(blurry, tmp_path, seen):
    blurry.renderformer_v2.property_unset("lens_samples")
    blurry.camera.data.dof.use_dof = blurry.render.use_motion_blur = True
    press_f12(blurry, tmp_path)
    assert len(seen["samples"]) == 2
    assert not any("no depth of field" in line or "no motion blur" in line for line in last_render.last_frame[0].report)


def test_all_samples_together_have_as_many_rays_as_a_sharp_picture():
    eight = Sampling(8)
    assert [Optics(lens_samples=lens).rays_of_sample(eight).most for lens in (1, 2, 3, 16)] == [8, 4, 3, 1]
    assert [Optics(lens_samples=lens).rays_of_picture(eight).most for lens in (1, 2, 3, 16)] == [8, 8, 24, 128]
    assert Optics().rays_of_picture(eight) == Optics(transparent_glass=True).rays_of_picture(eight) == eight


def test_blur_of_one_sample_is_reported_where_the_scene_wants_it(blurry, tmp_path):
    focused(blurry, 2)
    blurry.render.use_motion_blur = True
    blurry.renderformer_v2.lens_samples = blurry.renderformer_v2.shutter_samples = 1
    press_f12(blurry, tmp_path)
    report = last_render.last_frame[0].report
    assert any("Camera" in line and "depth of field" in line for line in report)
    assert any("no motion blur" in line for line in report)
    blurry.view_layers[0].use_motion_blur = False
    focused(blurry, 2, use_dof=False)
    press_f12(blurry, tmp_path)
    assert not any("no depth of field" in line or "no motion blur" in line for line in last_render.last_frame[0].report)


def test_moments_follow_the_shutter(scene):
    scene.frame_set(7)
    scene.render.motion_blur_shutter, scene.render.motion_blur_position = 0.5, "START"
    np.testing.assert_allclose(shutter.moments(scene, 4), 7 + np.array([1, 3, 5, 7]) / 16, atol=1e-3)
    scene.render.motion_blur_position = "END"
    np.testing.assert_allclose(shutter.moments(scene, 2), 7 - np.array([3, 1]) / 8, atol=1e-3)
    curve = scene.render.motion_blur_shutter_curve
    curve.curves[0].points[0].location = (0, 0)  # it opens slowly: most light arrives in the end
    curve.update()
    assert shutter.moments(scene, 2).mean() > 6.78
