# SPDX-License-Identifier: GPL-3.0-or-later
"""Stereoscopy: every view is what a camera in its place sees, and Blender's files have all of them."""
from contextlib import suppress

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine import compat, exr
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache

from tests.rf2_engine.convert.camera.test_camera import project
from tests.rf2_engine.f12 import cube, material, read_exr, sun

VIEWS = ("left", "right")


@pytest.fixture
def both(scene):
    """A cube and a smaller one before it, for two eyes."""
    cube(scene, of=material("Red", (0.8, 0.2, 0.1))).rotation_euler = (0.3, 0.2, 0.5)
    cube(scene, "Near", (0.4, -2, 0.2), material("Green", (0.1, 0.6, 0.2))).scale = (0.2, 0.2, 0.2)
    sun(scene)
    scene.render.use_multiview, scene.render.views_format = True, "STEREO_3D"
    stereo = scene.camera.data.stereo
    stereo.interocular_distance, stereo.convergence_distance, stereo.pivot = 0.5, 5, "CENTER"
    return scene


def rendered(scene, folder, name="picture", file_format="OPEN_EXR_MULTILAYER"):
    """Renders to files as users do."""
    compat.set_file_format(scene.render.image_settings, file_format)
    scene.render.image_settings.color_depth = "32" if "EXR" in file_format else "8"
    scene.render.filepath = str(folder / name)
    bpy.ops.render.render(scene=scene.name, write_still=True)


def passes_of(scene, folder):
    """Those of a file with all views."""
    rendered(scene, folder)
    return read_exr(folder / "picture.exr")


def cameras(scene):
    """One for each view, which differ."""
    scene.render.views_format = "MULTIVIEW"
    left = scene.camera
    right = bpy.data.objects.new("Camera_R", left.data.copy())
    left.name, right.location, right.rotation_euler, right.data.lens = "Camera_L", (1, -4, 0.5), (1.5, 0, 0.2), 30
    scene.collection.objects.link(right)


def toed_in(scene):
    stereo = scene.camera.data.stereo
    stereo.convergence_mode, stereo.pivot = "TOE", "LEFT"


def parallel(scene):
    scene.camera.data.stereo.convergence_mode, scene.camera.scale = "PARALLEL", (2, 2, 2)


def off_axis(scene):
    scene.camera.data.shift_x, scene.camera.data.sensor_fit = 0.1, "VERTICAL"


def blurred(scene):
    off_axis(scene)
    scene.camera.data.dof.use_dof, scene.camera.data.dof.focus_distance = True, 4
    scene.camera.data.dof.aperture_fstop, scene.renderformer_v2.lens_samples = 0.3, 2


def blurred_cameras(scene):
    blurred(scene)
    cameras(scene)


@pytest.mark.parametrize("how", [off_axis, toed_in, parallel, cameras, blurred, blurred_cameras])
def test_each_eye_looks_where_cycles_does(both, tmp_path, monkeypatch, how):
    seen = []

    def make_guides(found, tokens, view, real=first_hits.make_guides):
        seen.append((found, view))
        return real(found, tokens, view)
    monkeypatch.setattr(first_hits, "make_guides", make_guides)
    how(both)
    rendered(both, tmp_path)
    assert not last_render.last_frame[0].error and len(seen) == (4 if "blurred" in how.__name__ else 2)
    for found, view in seen:
        hit = found["depth"][..., 0] < 1e5
        y, x = np.nonzero(hit)
        pixels = np.array([project(view, point) for point in found["position"][hit]])
        assert len(pixels) > 50 and np.abs(pixels - np.stack([x, y], -1) - 0.5).max() < 0.05
    eyes = [view.camera_to_world[:3, 3] for _, view in seen[:2]]
    assert np.linalg.norm(eyes[0] - eyes[1]) == pytest.approx(0.5 if "cameras" not in how.__name__ else 1.5, abs=0.3)


def test_both_views_are_what_two_cameras_give_and_the_scene_is_encoded_once(both, tmp_path, monkeypatch):
    encoded = []

    def encode(network, *arguments, real=None):
        encoded.append(1)
        return kept(network, *arguments)
    rendered(both, tmp_path)  # loads the network
    network, = model_cache._cached.values()
    kept = type(network).encode
    monkeypatch.setattr(type(network), "encode", encode)
    model_cache._encoded.clear()
    found = passes_of(both, tmp_path)
    assert len(encoded) == 1
    both.render.use_multiview = False
    camera = both.camera
    lens, stereo = camera.data, camera.data.stereo
    aside = stereo.interocular_distance / 2
    for view, sign in zip(VIEWS, (-1, 1), strict=True):
        camera.location.x = sign * aside
        lens.shift_x = -sign * aside * lens.lens / (stereo.convergence_distance * lens.sensor_width)
        alone = passes_of(both, tmp_path)
        for name in ("Position", "Normal", "Depth"):
            np.testing.assert_allclose(found[f"ViewLayer.{name}.{view}"], alone[f"ViewLayer.{name}"], atol=1e-3)
        combined = found[f"ViewLayer.Combined.{view}"]
        assert psnr(combined[..., :3], alone["ViewLayer.Combined"][..., :3]) > 35
    assert psnr(*(found[f"ViewLayer.Combined.{view}"][..., :3] for view in VIEWS)) < 25


def test_files_have_blenders_suffixes_or_both_views(both, tmp_path):
    settings = both.render.image_settings
    rendered(both, tmp_path, "apart", "PNG")
    assert {path.name for path in tmp_path.iterdir()} == {"apart_L.png", "apart_R.png"}
    settings.views_format = "STEREO_3D"
    settings.stereo_3d_format.display_mode = "SIDEBYSIDE"
    bpy.ops.render.render(scene=both.name, write_still=True)
    assert list(bpy.data.images.load(str(tmp_path / "apart.png")).size) == [100, 37]


def test_passes_and_reference_are_there_for_each_view_and_compare_can_read_them(both, tmp_path):
    layer, chosen = both.view_layers[0], both.renderformer_v2.reference
    layer.use_pass_diffuse_direct = layer.use_pass_z = True
    chosen.use, chosen.samples, chosen.use_denoising = True, 2, False
    both.render.image_settings.exr_codec = "ZIP"
    found = passes_of(both, tmp_path)
    stats, = last_render.last_frame
    assert stats.reference_samples == 2 and "Cycles Reference" not in {remark.name for remark in stats.remarks}
    names = {name.rpartition(".")[0] for name in found}
    assert all(f"{name}.{view}" in found for name in names for view in VIEWS)
    assert not [name for name in names if "_00" in name]
    both.render.engine, both.cycles.samples = "CYCLES", 2
    both.cycles.use_adaptive_sampling = both.cycles.use_denoising = False
    theirs = passes_of(both, tmp_path)
    for view in VIEWS:
        np.testing.assert_allclose(found[f"ViewLayer.Cycles Reference.{view}"], theirs[f"ViewLayer.Combined.{view}"],
                                   atol=1e-5)
    both.render.engine, both.render.image_settings.exr_codec = "RENDERFORMER_V2", "NONE"
    chosen.use = False
    pixels = passes_of(both, tmp_path)
    read = exr.read(tmp_path / "picture.exr").passes
    for view, name in zip(VIEWS, ("Combined", "Combined.right"), strict=True):
        ours = np.stack([read["ViewLayer", name][channel] for channel in "RGBA"], -1)
        np.testing.assert_array_equal(ours, pixels[f"ViewLayer.Combined.{view}"])


def test_a_world_that_cycles_draws_is_the_same_with_two_cameras(both, tmp_path, monkeypatch):
    seen = []

    def make_guides(found, tokens, view, real=first_hits.make_guides):
        seen.append(tokens.environment)
        return real(found, tokens, view)
    monkeypatch.setattr(first_hits, "make_guides", make_guides)
    tree = both.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = "PREETHAM" if bpy.app.version < (5, 0) else "SINGLE_SCATTERING"
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    cameras(both)
    both.camera = bpy.data.objects["Camera_R"]
    rendered(both, tmp_path)
    both.render.use_multiview = False
    rendered(both, tmp_path)
    assert seen[0].std() > 0.01
    np.testing.assert_allclose(seen[0], seen[-1], atol=0.05 * float(seen[-1].max()))


def test_a_failure_shows_in_both_views(both, tmp_path):
    both.renderformer_v2.weights_source, both.renderformer_v2.weights_folder = "FOLDER", str(tmp_path / "none")
    with pytest.raises(RuntimeError, match="weights folder"):
        rendered(both, tmp_path)
    both.render.image_settings.views_format = "INDIVIDUAL"
    with suppress(RuntimeError):  # Blender saves both and says that it could not
        bpy.data.images["Render Result"].save_render(str(tmp_path / "error.exr"), scene=both)
    for suffix in ("L", "R"):
        combined = read_exr(tmp_path / f"error_{suffix}.exr")["ViewLayer.Combined"]
        assert combined[0, 0, :3] == pytest.approx([0.6, 0, 0.4], abs=1e-3)


def test_spherical_stereo_is_refused_where_it_can_be_switched_off(both, tmp_path):
    both.camera.data.type, both.camera.data.stereo.use_spherical_stereo = "PANO", True
    with pytest.raises(RuntimeError, match='"Camera" uses Spherical Stereo.*Camera Properties > Stereoscopy'):
        bpy.ops.render.render(scene=both.name)
    assert both.render.use_spherical_stereo  # which the panel asks
    both.camera.data.stereo.use_spherical_stereo = False
    bpy.ops.render.render(scene=both.name)
    assert not last_render.last_frame[0].error


def test_preflight_counts_the_views(both):
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda *_: None)
    assert found.views == 2 and "2 views of 50 x 37 pixels" in found.lines[0]
    state = preflight.state_of(both, both.view_layers[0])
    both.render.use_multiview = False
    assert preflight.state_of(both, both.view_layers[0]) != state
    assert "views" not in preflight.run(bpy.context.evaluated_depsgraph_get(), lambda *_: None).lines[0]
