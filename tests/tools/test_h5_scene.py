# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.render` on an H5 scene."""
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from skimage.io import imread

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.published.h5 import read_h5, write_h5
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.model.samples import floor_scene, floor_view
from tools.benchmark import ring
from tools.common.tone_mapping import tone_mapped
from tools.extension import ROOT
from tools.render import __main__ as render


def run(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["render", *map(str, arguments)])
    return render.main()


def test_every_camera_of_an_h5_scene_becomes_a_picture(tmp_path, monkeypatch, capfd):
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    view, _ = floor_view()
    views = [view, square_view(view.camera_to_world, 70, 64)]
    write_h5(tmp_path / "scene.h5", PublishedPipeline(bundle, "cpu", None).process(floor_scene(), views))
    assert run(monkeypatch, tmp_path / "scene.h5", "-o", tmp_path / "out.exr", "--weights", bundle,
               "--resolution", "72x72") == 0
    written = json.loads(capfd.readouterr().out)["output"]
    assert written == [str(tmp_path / f"out_{i:03d}.exr") for i in range(2)]
    pictures = []
    for path in written:
        with OpenEXR.File(path) as file:
            pictures.append(file.channels()["RGB"].pixels)
    assert pictures[0].shape == (72, 72, 3) and np.isfinite(pictures).all()
    assert not np.array_equal(*pictures)

    assert run(monkeypatch, tmp_path / "scene.h5", "-o", tmp_path / "out.png", "--weights", bundle,
               "--resolution", "72x72", "--tone-mapper", "agx") == 0
    shown = imread(tmp_path / "out_001.png").astype(int)
    assert np.abs(shown - tone_mapped(pictures[1], "agx")).max() <= 1


def test_a_blend_file_becomes_an_h5_scene_with_its_camera(tmp_path):
    import bpy
    ring.build(ring.LEAST, 64)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    command = [sys.executable, "-m", "tools.render", tmp_path / "scene.blend", "--weights", bundle,
               "--export-h5", tmp_path / "scene.h5"]
    done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    scene, said = read_h5(tmp_path / "scene.h5"), json.loads(done.stdout)
    assert len(scene.triangles) == said["triangles"] >= ring.LEAST
    np.testing.assert_allclose(scene.fov, [ring.FIELD_OF_VIEW], atol=1e-3)
    frame, expected = scene.metadata["normalization"], ring.camera_to_world()
    position = scene.camera_to_world[0, :3, 3] / frame["scale"] + frame["center"]
    np.testing.assert_allclose(position, expected[:3, 3], atol=1e-3)
    np.testing.assert_allclose(scene.camera_to_world[0, :3, :3], expected[:3, :3], atol=1e-5)


@pytest.mark.parametrize("size, message", [
    (np.nan, "scene.h5: triangles is not finite"), (3e38, "scene.h5: .*picture holds values that are not finite")])
def test_what_is_not_finite_becomes_no_picture(tmp_path, monkeypatch, capfd, size, message):
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    scene = PublishedPipeline(bundle, "cpu", None).process(floor_scene(), [floor_view()[0]])
    write_h5(tmp_path / "scene.h5", replace(scene, triangles=np.sign(scene.triangles) * np.float32(size)))
    assert run(monkeypatch, tmp_path / "scene.h5", "-o", tmp_path / "out.exr", "--weights", bundle,
               "--resolution", "64x64") == 1
    assert re.search(message, capfd.readouterr().err) and not (tmp_path / "out.exr").exists()


@pytest.mark.parametrize("name, arguments, message", [
    ("scene.h5", ["--weights", "rf2_small"], "--weights"), ("scene.h5", ["--weights", "WEIGHTS"], "WEIGHTS"),
    ("scene.h5", [], "--weights"), ("SCENE.H5", [], "--weights"), ("scene.hdf5", [], "--weights"),
    ("scene.h5", ["--engine", "cycles"], "--engine"), ("scene.h5", ["--samples", "4"], "--samples")])
def test_what_an_h5_scene_cannot_be_rendered_with_is_refused(tmp_path, monkeypatch, capfd, name, arguments, message):
    (tmp_path / name).write_bytes(b"")
    assert run(monkeypatch, tmp_path / name, "-o", tmp_path / "out.exr", *arguments) == 1
    error = capfd.readouterr().err
    assert message in error and error.count("\n") == 1


def test_an_h5_scene_is_not_exported_again(tmp_path, monkeypatch, capfd):
    (tmp_path / "scene.h5").write_bytes(b"")
    assert run(monkeypatch, tmp_path / "scene.h5", "--export-h5", tmp_path / "other.h5", "--weights", "DIR") == 1
    assert "H5 scene already" in capfd.readouterr().err
