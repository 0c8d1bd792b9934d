# SPDX-License-Identifier: GPL-3.0-or-later
"""What F12 makes of the settings: keyframes, threads, and folders beside the .blend file."""
import shutil
from pathlib import Path

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.model.weights import presets
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session as cycles_session
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight, render
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, press_f12


@pytest.mark.parametrize("persistent", [False, True])
def test_keyframed_settings_are_those_of_each_frame(scene, tmp_path, monkeypatch, persistent):
    cube(scene)
    settings = scene.renderformer_v2
    for frame, budget, samples in ((1, 300, 2), (2, 500, 5)):
        settings.token_budget, settings.guide_samples = budget, samples
        settings.keyframe_insert("token_budget", frame=frame)
        settings.keyframe_insert("guide_samples", frame=frame)
    settings.max_edge = 0.02  # fills any budget
    used, triangles = [], []

    def first_hits(engine, depsgraph, options, report, real=cycles_session.render_views):
        used.append(options.sampling.most)
        return real(engine, depsgraph, options, report)
    monkeypatch.setattr(cycles_session, "render_views", first_hits)
    keep = lambda *_: triangles.append(last_render.last_frame[0].triangles)  # noqa: E731
    bpy.app.handlers.render_post.append(keep)
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 2, str(tmp_path / "frame_")
    scene.render.use_persistent_data = persistent
    bpy.ops.render.render(animation=True, scene=scene.name)
    bpy.app.handlers.render_post.remove(keep)
    assert used == [2, 5]
    assert triangles[0] <= 300 < triangles[1] <= 500


@pytest.mark.parametrize("size, percentage, samples", [
    ((512, 512), 100, 8), ((1920, 1080), 100, 8), ((512, 256), 100, 16), ((256, 256), 100, 32), ((64, 64), 100, 128),
    ((512, 512), 50, 32)])
def test_small_pictures_have_as_many_rays_as_larger_ones(scene, size, percentage, samples):
    scene.renderformer_v2.guide_samples, render = 0, scene.render
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = percentage
    render.use_border, render.border_max_x = True, 0.5  # parts of a picture on several computers have the same
    assert FrameSettings.read(scene).sampling.most == samples


def test_a_number_of_samples_is_that_of_pictures_of_any_size_and_a_view_layer_may_have_its_own(scene):
    ours, layer = scene.renderformer_v2, scene.view_layers[0]
    ours.guide_samples, ours.use_adaptive_sampling, ours.adaptive_threshold = 40, True, 0.05
    ours.adaptive_min_samples = 20
    assert FrameSettings.read(scene, layer).sampling == pytest.approx((40, 0.05, 20))
    layer.renderformer_v2.samples, ours.use_adaptive_sampling = 3, False
    assert FrameSettings.read(scene, layer).sampling == (3, 0, 20)


def test_files_and_presets_of_earlier_versions_keep_their_number_of_samples(scene, tmp_path):
    cube(scene)
    ours = scene.renderformer_v2
    ours.guide_samples, ours.more_when_small = 12, False  # what an old preset runs, and an old file holds
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    assert FrameSettings.read(bpy.context.scene).sampling.most == 12


def test_a_weights_folder_is_relative_to_the_blend_file(scene, tmp_path):
    cube(scene)
    shutil.copytree(presets.weights_folder(presets.BUNDLED), tmp_path / "network")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", "//network"
    press_f12(scene, tmp_path)
    assert Path(last_render.last_frame[0].weights) == tmp_path / "network"


@pytest.mark.parametrize("ours, blenders, expected", [
    (("AUTO", 3), ("AUTO", 5), 0), (("AUTO", 3), ("FIXED", 5), 5), (("FIXED", 3), ("FIXED", 5), 3),
    (("FIXED", 3), ("AUTO", 5), 3),
])
def test_threads_are_ours_or_else_blenders(scene, ours, blenders, expected):
    scene.renderformer_v2.threads_mode, scene.renderformer_v2.threads = ours
    scene.render.threads_mode = "FIXED"
    scene.render.threads = blenders[1]
    scene.render.threads_mode = blenders[0]
    assert FrameSettings.read(scene).threads == expected


def test_the_network_computes_with_as_many_threads_as_the_setting_says(scene, tmp_path, monkeypatch):
    import torch
    cube(scene)
    press_f12(scene, tmp_path)
    before, seen = torch.get_num_threads(), []

    def encoded(*arguments, real=render.model_cache.encoded):
        seen.append(torch.get_num_threads())
        return real(*arguments)
    monkeypatch.setattr(render.model_cache, "encoded", encoded)
    scene.renderformer_v2.threads_mode, scene.renderformer_v2.threads = "FIXED", before + 1
    press_f12(scene, tmp_path)
    scene.renderformer_v2.threads_mode = "AUTO"
    press_f12(scene, tmp_path)
    assert seen == [before + 1, before] and torch.get_num_threads() == before
    assert scene.render.threads_mode == "AUTO"


def test_a_weights_folder_that_is_none_is_found_before_cycles_works(scene, tmp_path, monkeypatch):
    cube(scene)
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", str(tmp_path)
    worked = []
    monkeypatch.setattr(cycles_session, "render_views", lambda *_, **__: worked.append(1))
    with pytest.raises(RuntimeError):
        bpy.ops.render.render(scene=scene.name)
    assert last_render.last_frame[0].error and not worked


def test_a_frame_of_less_than_a_pixel_counts_as_one(scene):
    """Blender 4.5 refuses to render it, but panels and viewports read its settings."""
    cube(scene)
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.resolution_percentage = 1
    scene.renderformer_v2.guide_samples = 0
    assert FrameSettings.read(scene).sampling.most == 128
    result = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    assert not result.error and result.size == (1, 1)
