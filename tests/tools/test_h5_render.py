# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders and lists of H5 scenes are rendered and converted as by the authors' command line."""
import json
import sys

import bpy
import h5py
import numpy as np
import OpenEXR
import pytest
from skimage.io import imread

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.published.h5 import read_h5, write_h5
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.model.samples import floor_scene, floor_view
from tools.common.tone_mapping import tone_mapped
from tools.h5 import convert, render
from tools.h5.inputs import list_inputs

SIZE = 64


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return write_bundle(tmp_path_factory.mktemp("bundle") / "renderformer-v2", tiny_published_config())


@pytest.fixture
def folder(tmp_path, bundle):
    """Two scenes, of two views and one."""
    (tmp_path / "scenes").mkdir()
    view = floor_view()[0]
    views = [view, square_view(view.camera_to_world, 70, SIZE)]
    pipeline = PublishedPipeline(bundle, "cpu", None)
    for name, shown in (("scene_2.h5", views), ("scene_10.h5", views[:1])):
        write_h5(tmp_path / "scenes" / name, pipeline.process(floor_scene(), shown))
    return tmp_path / "scenes"


def run(monkeypatch, tool, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", [tool.__name__, *map(str, arguments)])
    return tool.main()


def lines(capfd) -> list[dict]:
    return [json.loads(line) for line in capfd.readouterr().out.splitlines()]


def radiance(path) -> np.ndarray:
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGB"].pixels


def test_a_folder_becomes_pictures_of_every_view_and_a_video(folder, bundle, tmp_path, monkeypatch, capfd):
    assert run(monkeypatch, render, folder, "-o", tmp_path / "out", "--weights", bundle, "--resolution", SIZE,
               "--device", "cpu", "--precision", "fp32", "--view-batch-size", 2, "--video") == 0
    *scenes, video = lines(capfd)
    assert [(line["views"], line["texture"]) for line in scenes] == [(2, "encoded"), (1, "encoded")]
    names = [f"scene_{name}" for name in ("2_view_0", "2_view_1", "10_view_0")]
    assert [output for line in scenes for output in line["output"]] == [
        str(tmp_path / "out" / f"{name}.exr") for name in names]
    for name in names:
        linear, shown = radiance(tmp_path / "out" / f"{name}.exr"), imread(tmp_path / "out" / f"{name}.png")
        assert linear.shape == shown.shape == (SIZE, SIZE, 3) and np.array_equal(shown, tone_mapped(linear))
    clip = bpy.data.movieclips.load(video["video"])
    assert (clip.frame_duration, tuple(clip.size), clip.fps) == (3, (SIZE, SIZE), 24)


def test_the_first_view_is_enough_and_a_list_names_tone_mappers(folder, bundle, tmp_path, monkeypatch, capfd):
    (folder / "list.txt").write_text("# two\nscene_10.h5\n\nscene_2.h5 agx\n")
    assert run(monkeypatch, render, folder / "list.txt", "-o", tmp_path / "out", "--weights", bundle, "--resolution",
               SIZE, "--first-view-only", "--tone-mapper", "none", "--device", "cpu") == 0
    assert [(line["views"], line["tone_mapper"]) for line in lines(capfd)] == [(1, "none"), (1, "agx")]
    for name, mapper in (("scene_10", "none"), ("scene_2", "agx")):
        linear = radiance(tmp_path / "out" / f"{name}_view_0.exr")
        assert np.array_equal(imread(tmp_path / "out" / f"{name}_view_0.png"), tone_mapped(linear, mapper))


def test_tone_mappers_are_blenders():
    grey = np.full((1, 1, 3), 0.18, np.float32)
    shown = {name: tone_mapped(grey, name)[0, 0, 0] for name in ("standard", "none", "agx", "filmic", "pbr_neutral")}
    assert shown["none"] == 45 and shown["standard"] == shown["agx"] == 118 and shown["filmic"] > 118
    assert shown["pbr_neutral"] == round(255 * (1.055 * 0.14 ** (1 / 2.4) - 0.055))  # Khronos: minus 0.04


def test_files_can_be_checked_without_drawing(folder, bundle, monkeypatch, capfd):
    assert run(monkeypatch, render, folder, "--weights", bundle, "--validate-only") == 0
    assert [line["triangles"] for line in lines(capfd)] == [len(floor_scene())] * 2


def test_the_first_file_that_cannot_be_rendered_is_named(folder, bundle, monkeypatch, capfd):
    with h5py.File(folder / "scene_10.h5", "a") as file:
        del file["c2w"]
    assert run(monkeypatch, render, folder, "--weights", bundle, "--validate-only") == 1
    out, error = capfd.readouterr()
    assert len(out.splitlines()) == 1 and "scene_10.h5: c2w is missing" in error and error.count("\n") == 1


def test_a_raw_file_becomes_a_processed_one(folder, bundle, tmp_path, monkeypatch, capfd):
    path, cells = folder / "scene_10.h5", 2
    raw = np.zeros((len(floor_scene()), 16, 32, 32), np.float16)
    raw[:, :9], raw[:, 11], raw[-1, 12:15] = 0.25, 1, 40
    with h5py.File(path, "a") as file:
        for key in ("texture", "light_strength"):
            del file[key]
        file["texture"] = raw
        file["volume_data"] = np.ones((cells, 4, 4, 4), np.float32)
        for key in ("position", "rotation", "scale", "scattering_scale", "absorption_scale"):
            file[f"volume_{key}"] = np.full((cells, 3), 0.5, np.float32)
        file["env_map"], file["env_map_strength"] = np.ones((256, 512, 3), np.float32), np.float32([2])
    assert run(monkeypatch, convert, path, "-o", tmp_path / "processed.h5", "--weights", bundle, "--device", "cpu") == 0
    assert lines(capfd)[0]["volume_cells"] == cells
    before, after = read_h5(path), read_h5(tmp_path / "processed.h5")
    assert before.is_raw and not after.is_raw and after.metadata["postprocessed"]
    assert after.volumes.density.shape == (cells, 64) and (after.environment == 2).all()
    np.testing.assert_array_equal(after.light_strength, before.light_strength)
    encoder = PublishedPipeline(bundle, "cpu", None).encoder
    np.testing.assert_array_equal(encoder.encoded(before).texture, after.texture)


@pytest.mark.parametrize("text, message", [("", "names no H5 scene"), ("a/scene_2.h5\nscene_2.h5", "same name")])
def test_lists_that_cannot_be_rendered_are_refused(folder, text, message):
    (folder / "a").mkdir()
    (folder / "a" / "scene_2.h5").write_bytes((folder / "scene_2.h5").read_bytes())
    (folder / "list.txt").write_text(text)
    with pytest.raises(ValueError, match=message):
        list_inputs(folder / "list.txt")
