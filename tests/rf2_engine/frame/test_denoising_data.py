# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture is the same whatever passes are ticked, with a denoiser and without one."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat, passes

from tests.rf2_engine.f12 import press_f12
from tests.rf2_engine.still_life import build, tick, tick_own

PICTURES = "ViewLayer.Combined", "ViewLayer.Cycles Reference"


@pytest.mark.parametrize("light, has_denoiser, use_denoising", [
    pytest.param(light, *others, marks=pytest.mark.slow if (i + j) % 2 else ())
    for i, light in enumerate(("TRACED", "NETWORK"))
    for j, others in enumerate(((True, True), (True, False), (False, False), (False, True)))])
def test_no_pass_changes_the_picture(scene, tmp_path, monkeypatch, light, has_denoiser, use_denoising):
    """`use_denoising`: of the scene, with which Cycles has a Noisy Image; the reference beside it is not denoised."""
    build(scene)
    scene.cycles.use_denoising, scene.renderformer_v2.light = use_denoising, light
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples, reference.use_denoising = True, 4, False
    if not has_denoiser:
        monkeypatch.setattr(compat, "has_openimagedenoise", lambda: False)
    layer = scene.view_layers[0]
    tick(layer, ())
    plain = press_f12(scene, tmp_path)
    tick(layer, {p.key for p in passes.PASSES})
    tick_own(layer)
    every = press_f12(scene, tmp_path)
    always = has_denoiser and light == "TRACED"
    assert ["ViewLayer.Noisy Image" in found for found in (plain, every)] == [always, always or use_denoising]
    for name in PICTURES:
        assert plain[name][..., :3].mean() > 0.1
        np.testing.assert_allclose(every[name], plain[name], atol=2e-3)
