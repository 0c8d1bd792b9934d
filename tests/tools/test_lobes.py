# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.evaluate.lobes`: what is estimated of each lobe, by material, beside Cycles' passes."""
import sys

import numpy as np
import pytest

from tests.model.samples import floor_view, walls
from tools.datagen.sample_files import save_sample
from tools.evaluate import lobes
from tools.evaluate.lobes import PASSES
from tools.evaluate.samples import estimated_light, world_radiance


@pytest.fixture
def sample(tmp_path, monkeypatch):
    """A function that writes a sample of a floor whose passes are `factor` times our estimates, and its folder."""
    from renderformer_v2.model.renderer import Renderer

    def write(factor):
        scene, (view, guides) = walls((0.6, 0.2, 0.2)), floor_view()
        encoded = Renderer("rf2_small", device="cpu", precision="fp32").encode(scene)
        light = estimated_light(encoded, view, guides)
        passes = {key: np.zeros_like(guides.diffuse_color) for keys in PASSES.values() for key in keys}
        passes |= {f"diffuse_{kind}": factor * world_radiance(encoded, lobes)[0]
                   for kind, lobes in (("direct", light.direct), ("indirect", light.indirect()))}
        color = sum(passes[f"diffuse_{kind}"] * guides.diffuse_color for kind in ("direct", "indirect"))
        passes |= {"combined": np.dstack([color, guides.alpha]), "environment": np.zeros_like(color)}
        save_sample(tmp_path / "scene_00000001.npz", scene, [view], [guides], [passes])
        monkeypatch.setattr(sys, "argv", ["lobes", str(tmp_path)])
        return tmp_path

    return write


@pytest.mark.parametrize("factor", [pytest.param(1.0, marks=pytest.mark.slow), 2.0])
def test_ratios_are_those_of_the_light(sample, factor, capsys):
    sample(factor)
    assert lobes.main() == 0
    rows = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[:4] for row in rows] == [["diffuse direct", "matte or glossy", "0.45", "1"],
                                         ["diffuse indirect", "matte or glossy", "0.45", "1"]][:len(rows)] and rows
    assert [float(row[4]) for row in rows] == pytest.approx([1 / factor] * len(rows), abs=0.02)


def test_without_samples_it_says_how_to_make_some(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["lobes", str(tmp_path)])
    assert lobes.main() == 2 and "tools.datagen" in capsys.readouterr().err
