# SPDX-License-Identifier: GPL-3.0-or-later
"""What F12 makes of the settings: keyframes, threads, and folders beside the .blend file."""
import shutil
from pathlib import Path

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.model.weights import presets
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session as cycles_session
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.settings import FrameSettings

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

    def first_hits(*arguments, real=cycles_session.render_views, **options):
        used.append(options["samples"])
        return real(*arguments, **options)
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
    ((512, 512), 100, 3), ((1920, 1080), 100, 3), ((512, 256), 100, 6), ((400, 300), 100, 7), ((256, 256), 100, 12),
    ((64, 64), 100, 48), ((512, 512), 50, 12)])
def test_small_pictures_have_as_many_rays_as_larger_ones_up_to_sixteen_times_as_many_a_pixel(scene, size, percentage,
                                                                                           samples):
    ours, render = scene.renderformer_v2, scene.render
    ours.guide_samples, ours.more_when_small = 3, True
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = percentage
    assert FrameSettings.read(scene).guide_samples == samples
    ours.more_when_small = False
    assert FrameSettings.read(scene).guide_samples == 3


def test_samples_of_a_view_layer_are_more_in_small_pictures_too(scene):
    scene.renderformer_v2.more_when_small, scene.view_layers[0].renderformer_v2.samples = True, 5
    assert FrameSettings.read(scene, scene.view_layers[0]).guide_samples == 80


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
