# SPDX-License-Identifier: GPL-3.0-or-later
"""Each thing that light does is there, and as strong as in Cycles: examples/effects.py, beside a reference."""
from typing import NamedTuple

import bpy
import numpy as np
import pytest

import addon_utils

from examples import effects
from renderformer_v2.model.metrics.scores import compare
from tests.rf2_engine.f12 import press_f12
from tests.rf2_engine.installed import PACKAGE

SIZE = 64


class Place(NamedTuple):
    """Rows and columns of a square of 64 pixels."""

    top: int
    left: int
    side: int = 5

    def mean(self, picture: np.ndarray) -> np.ndarray:
        return picture[self.top:self.top + self.side, self.left:self.left + self.side, :3].mean((0, 1))


class Effect(NamedTuple):
    """What is seen at one place and not at the other."""

    there: Place
    not_there: Place
    least: float      # PSNR of the picture, dB
    tolerance: float  # of the light there, over that of the other place, relative to Cycles'


EFFECTS = {
    "shadow": Effect(Place(38, 48, 3), Place(56, 10), 34, 0.15),
    "mirror": Effect(Place(17, 30, 3), Place(12, 12), 30, 0.3),
    "glass": Effect(Place(33, 27), Place(33, 4), 27, 0.45),  # light that reaches it through the pane is missing
    "bleeding": Effect(Place(38, 38), Place(4, 4), 33, 0.2),
    "fog": Effect(Place(30, 28), Place(2, 58), 35, 0.2),
    "ground": Effect(Place(40, 30), Place(2, 2), 34, 0.15),
    "sky": Effect(Place(18, 30), Place(46, 30), 39, 0.1),
    "panel": Effect(Place(20, 8, 3), Place(42, 18, 8), 25, 0.22),  # beside the lamp, and the cube below
}


def rendered(name: str, tmp_path) -> tuple[np.ndarray, np.ndarray]:
    """Our picture and Cycles' reference, (H, W, 4) both."""
    getattr(effects, name)()
    addon_utils.enable(PACKAGE)
    scene = bpy.context.scene
    scene.render.engine, scene.view_layers[0].name = "RENDERFORMER_V2", "Layer"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples, reference.use_denoising = True, 128, True
    passes = press_f12(scene, tmp_path)
    return passes["Layer.Combined"], passes["Layer.Cycles Reference"]


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_there_as_in_cycles(name, tmp_path):
    ours, cycles = rendered(name, tmp_path)
    there, not_there, least, tolerance = EFFECTS[name]
    assert compare(ours[..., :3], cycles[..., :3]).psnr >= least
    contrast = [there.mean(picture) / np.maximum(not_there.mean(picture), 0.02) for picture in (ours, cycles)]
    assert np.abs(np.log(contrast[1])).max() > 0.25, "an effect worth the name"
    np.testing.assert_allclose(contrast[0], contrast[1], rtol=tolerance)
