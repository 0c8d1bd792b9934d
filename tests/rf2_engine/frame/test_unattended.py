# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders that nobody watches: a frame that failed leaves no file, and what is wrong is said before any work."""
from pathlib import Path

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, press_f12

LOST = str(Path("/there/is/no/such/folder"))  # as this system writes it


@pytest.fixture
def saved(scene, tmp_path):
    """Renders frames 1 to 3 of the scene; the names of the files that are there afterwards."""
    cube(scene)
    scene.frame_start, scene.frame_end = 1, 3
    scene.render.filepath = str(tmp_path / "picture_")

    def run(**how) -> list[str]:
        try:
            bpy.ops.render.render(scene=scene.name, **how)
        except RuntimeError:
            pass
        return sorted(path.name for path in tmp_path.glob("*"))
    return run


def wrong_weights_from_frame_2(scene):
    ours = scene.renderformer_v2
    ours.weights_folder = LOST
    for frame, source in ((1, "BUNDLED"), (2, "FOLDER")):
        ours.weights_source = source
        ours.keyframe_insert("weights_source", frame=frame)


def test_an_animation_ends_at_the_frame_that_failed_and_saves_nothing_of_it(scene, saved):
    wrong_weights_from_frame_2(scene)
    assert saved(animation=True) == ["picture_0001.png"]
    assert LOST in last_render.last_frame[0].error


def test_a_still_picture_that_failed_is_not_saved(scene, saved):
    wrong_weights_from_frame_2(scene)
    scene.frame_set(2)
    assert saved(write_still=True) == []


@pytest.mark.parametrize("how", ["animation", "write_still"])
def test_a_fault_of_ours_saves_no_empty_frame(scene, saved, monkeypatch, how):
    def broken(depsgraph):
        raise ZeroDivisionError

    monkeypatch.setattr(render.Optics, "read", broken)
    assert saved(**{how: True}) == []
    assert "ZeroDivisionError" in last_render.last_frame[0].error


@pytest.mark.parametrize("how", ["animation", "write_still"])
def test_an_interruption_saves_no_empty_frame(scene, saved, monkeypatch, how):
    """Ctrl-C in a Python that has imported bpy; Blender would go on with the next frame."""
    def interrupted(depsgraph):
        raise KeyboardInterrupt

    monkeypatch.setattr(render.Optics, "read", interrupted)
    assert saved(**{how: True}) == []
    assert last_render.last_frame[0].cancelled and bpy.context.scene.frame_current == 1


def test_placeholders_of_frames_that_failed_are_removed_and_those_of_others_are_left_alone(scene, saved, tmp_path):
    wrong_weights_from_frame_2(scene)
    scene.render.use_placeholder, scene.render.use_overwrite = True, False
    (tmp_path / "picture_0001.png").touch()  # another machine is at it
    assert saved(animation=True) == ["picture_0001.png"]
    assert (tmp_path / "picture_0001.png").stat().st_size == 0
    scene.animation_data_clear()
    scene.renderformer_v2.weights_source = "BUNDLED"
    assert saved(animation=True) == [f"picture_000{i}.png" for i in (1, 2, 3)]
    assert [(tmp_path / f"picture_000{i}.png").stat().st_size > 0 for i in (1, 2, 3)] == [False, True, True]


def test_threads_and_number_formats_change_a_picture_by_no_more_than_rounding(still_life, scene, tmp_path):
    def rendered(precision: str, threads: int) -> np.ndarray:
        scene.renderformer_v2.precision = precision
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
        return press_f12(scene, tmp_path)["ViewLayer.Combined"][..., :3]

    one, again, two, half = (rendered(*how) for how in (("fp32", 1), ("fp32", 1), ("fp32", 2), ("bf16", 1)))
    np.testing.assert_array_equal(one, again)
    assert psnr(one.clip(0, 1), two.clip(0, 1)) >= 99  # the most that it says is 100
    assert psnr(one.clip(0, 1), half.clip(0, 1)) >= 50 and not np.array_equal(one, half)


@pytest.mark.parametrize("content", [None, [], ["config.json"], ["model_index.json.txt"], ["transformer_512"]])
def test_a_folder_without_weights_is_found_before_the_scene_is_converted(scene, saved, tmp_path_factory, monkeypatch,
                                                                         content):
    def convert(layer):
        raise AssertionError("the scene was converted")

    folder = tmp_path_factory.mktemp("weights") / "mine"
    if content is not None:
        folder.mkdir()
        for name in content:
            (folder / name).write_text("{}")
    monkeypatch.setattr(render.Layer, "convert", convert)
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", str(folder)
    assert saved(write_still=True) == []
    assert str(folder) in last_render.last_frame[0].error and "converted" not in last_render.last_frame[0].error
