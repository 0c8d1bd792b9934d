# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.render` on an H5 scene."""
import json
import sys

import numpy as np
import OpenEXR
import pytest

from model.camera import square_view
from model.h5 import write_h5
from model.pipelines.published import PublishedPipeline
from tests.model.published import tiny_published_config, write_bundle
from tests.model.samples import floor_scene, floor_view
from tools import render


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


@pytest.mark.parametrize("arguments, message", [
    (["--weights", "small"], "--weights"), (["--weights", "WEIGHTS"], "WEIGHTS"), ([], "--weights")])
def test_other_weights_are_refused(tmp_path, monkeypatch, capfd, arguments, message):
    (tmp_path / "scene.h5").write_bytes(b"")
    assert run(monkeypatch, tmp_path / "scene.h5", "-o", tmp_path / "out.exr", *arguments) == 1
    assert message in capfd.readouterr().err
