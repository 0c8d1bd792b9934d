# SPDX-License-Identifier: GPL-3.0-or-later
"""What a network could add is measured by mending what is known to be wrong."""
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.presets import BUNDLED
from tests.model.samples import floor_view, walls
from tools.datagen.sample_files import save_sample
from tools.evaluate.oracles import FACTORS, ORACLES, CorrectableView, prepare_view

ROOT = Path(__file__).parents[2]
FACTOR = float(FACTORS[len(FACTORS) // 2 + 4])


@pytest.fixture(scope="module")
def lit() -> CorrectableView:
    """A view of walls as the network is given it, with much more bounced light."""
    view, guides = floor_view()
    black = np.zeros_like(guides.diffuse_color)
    passes = {"combined": np.dstack([black, guides.alpha]), "environment": black, "diffuse_indirect": black}
    encoded = Renderer(BUNDLED, device="cpu", precision="fp32").encode(walls((0.6, 0.2, 0.2)))
    found = prepare_view(encoded, view, guides, passes)
    return replace(found, indirect=found.indirect * (0.05 / found.indirect.mean()))


def gains(view: CorrectableView) -> dict[str, float]:
    found = {name: oracle([view]) for name, oracle in ORACLES.items()}
    return {name: value - found["without_network"] for name, value in found.items()}


def test_factors_mend_bounced_light_that_is_too_dark_everywhere(lit):
    found = gains(replace(lit, reference=lit.picture((FACTOR,) * 3)))
    assert min(found[f"factor_per_{what}"] for what in ("scene", "lobe", "place")) > 10


def test_a_factor_of_one_lobe_mends_what_one_for_all_does_not(lit):
    left = (np.arange(lit.rest.shape[1]) < lit.rest.shape[1] // 2)[:, None]
    some = replace(lit, indirect=np.stack([left * lit.indirect[0], ~left * lit.indirect[0], 0 * lit.indirect[0]]))
    found = gains(replace(some, reference=some.picture((1.0, FACTOR, 1.0))))
    assert found["factor_per_lobe"] > found["factor_per_scene"] + 5


def test_the_reference_s_own_bounced_light_mends_any_error_of_ours(lit):
    diffuse = lit.indirect[0] * np.linspace(0.5, 2, lit.indirect.shape[2])[:, None]
    found = gains(replace(lit, diffuse=diffuse, reference=lit.picture((0.0, 1.0, 1.0)) + diffuse))
    assert found["cycles_diffuse"] > 20


def test_the_smoothed_difference_mends_light_that_is_missing_and_no_noise(lit):
    noise = np.random.default_rng(0).normal(0, 0.02, lit.rest.shape)
    missing, noisy = (gains(replace(lit, reference=lit.picture() + light))["smoothed_difference"]
                      for light in (np.float32(0.1), noise))
    assert missing > 10 and noisy < 1


@pytest.mark.slow
def test_the_command_prints_both_settings(tmp_path):
    view, guides = floor_view()
    guides = replace(guides, traced=np.full_like(guides.diffuse_color, 0.25))
    passes = {name: np.full_like(guides.diffuse_color, 0.1) for name in ("environment", "diffuse_indirect")}
    combined = np.dstack([0.5 * guides.diffuse_color, guides.alpha])
    save_sample(tmp_path / "scene_00000001.npz", walls((0.6, 0.2, 0.2)), [view], [guides],
                [passes | {"combined": combined}])
    command = [sys.executable, "-m", "tools.evaluate.oracles", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert list(found) == ["traced_hints", "network_and_rays"]
    assert all(list(oracles) == list(ORACLES) for oracles in found.values())
