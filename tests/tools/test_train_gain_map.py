# SPDX-License-Identifier: GPL-3.0-or-later
"""The gain map is trained alone, from small pictures that are kept; without Blender."""
from argparse import Namespace

import torch

from renderformer_v2.model.checkpoint import load_material_mapper, load_network
from renderformer_v2.model.guided.decoding import SEEN
from renderformer_v2.model.guided.gain_map import GainMap
from renderformer_v2.model.presets import BUNDLED, weights_folder
from tests.tools.test_train import stored  # noqa: F401 - a fixture
from tools.train import apart
from tools.train import gain_map as training
from tools.train.gain_map import CHANNELS
from tools.train.samples import build_sample, with_latents


def test_samples_become_small_pictures_once(stored, tmp_path):  # noqa: F811
    (tmp_path / "scene_00000002.npz").write_bytes(b"no sample")
    network, mapper = load_network(weights_folder(BUNDLED)), load_material_mapper()
    options = Namespace(data=tmp_path, rendered=tmp_path / "cells", processes=1)

    def cells():
        return apart.rendered(options, network, ("gain_map",), lambda path: training.cells(
            network, with_latents(build_sample(path), mapper)))

    first = cells()
    (file,) = options.rendered.iterdir()
    made = file.stat().st_mtime_ns
    assert len(first) == 1 and first[0].shape == (1, sum(CHANNELS), 16, 16)
    torch.nn.init.ones_(network.gain_map.leave.bias)  # which they do not depend on
    assert torch.equal(cells()[0], first[0]) and file.stat().st_mtime_ns == made
    assert (first[0][:, SEEN.index("hinted")] == 0).all()  # nothing was traced in this sample


def test_a_wrong_brightness_is_learnt():
    torch.manual_seed(0)
    samples = []
    for _ in range(8):
        before = torch.rand(2, 3, 16, 16) * 0.4 + 0.1
        samples.append(torch.cat([torch.randn(2, CHANNELS[0], 16, 16), before, 1.5 * before], 1).half())
    gain_map, written = GainMap(CHANNELS[0], 8, 3), []
    training.train(gain_map, samples, 4.0, lambda: written.append(1))
    gain_map.eval()
    seen = samples[0][:, :CHANNELS[0]].float()
    found = training.factor(gain_map(seen)).detach()
    assert written and abs(float(found.mean()) - 1.5) < 0.1


def test_the_command_says_what_is_missing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["gain_map", "--data", str(tmp_path), "--out", str(tmp_path), "--minutes", "1"])
    assert training.main() == 2 and "tools.datagen" in capsys.readouterr().err
