# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps behind glass, as gloss shows them: through panes, not where glass bends their light."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.estimate import estimate_light
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.scene import IOR, ROUGHNESS, TRANSMISSION, RenderScene
from tests.model.samples import flat, floor_scene, floor_view, scene_light

RED, SIDE = (1.0, 0.25, 0.25), 9
UP = torch.tensor([[0.0, 0.0, 1.0]])


def red_glass(*heights: tuple[float, float]) -> RenderScene:
    """Sheets between the floor and its lamp with such heights on the left and on the right; every other faces down."""
    sheets = []
    for number, (left, right) in enumerate(heights):
        a, b, c, d = (-SIDE, -SIDE, left), (SIDE, -SIDE, right), (SIDE, SIDE, right), (-SIDE, SIDE, left)
        sheet = np.float32([(a, b, c), (a, c, d)])
        sheets.append(sheet[:, ::-1] if number % 2 else sheet)
    glass = flat(np.concatenate(sheets), np.float32(RED))
    glass.tiles[:, TRANSMISSION], glass.tiles[:, IOR] = 1, 1.5
    return glass


def mirrored(light: DirectLight) -> np.ndarray:
    """(3,) radiance of the lamps in rough metal in the middle of the floor."""
    return light.highlights(torch.zeros(1, 3), UP, torch.full((1, 4, 2), 0.5), UP, torch.tensor([0.3]),
                            torch.ones(1))[0].numpy()


@pytest.mark.parametrize("glass, share", (
    (red_glass((0.2, 0.2)), 0.96 * np.sqrt(RED)),
    (red_glass((0.25, 0.25), (0.2, 0.2)), 0.96 ** 2 * np.float32(RED)),
    (red_glass((0.2 + 0.3 * SIDE, 0.2 - 0.3 * SIDE), (0.1, 0.1)), np.zeros(3)),
), ids=("a sheet", "a pane", "a prism"))
def test_gloss_shows_the_lamps_whose_light_goes_straight_through_glass(glass, share):
    bare = floor_scene(side=3)
    stopped = DirectLight(bare.appended(glass))
    assert not mirrored(stopped).any()
    np.testing.assert_allclose(mirrored(stopped.through_glass), mirrored(DirectLight(bare)) * share, rtol=0.03)


def test_what_no_glass_is_before_is_not_seen_through_glass():
    beside = red_glass((0.2, 0.2))
    beside.triangles[..., 0] += 3 * SIDE
    light = DirectLight(floor_scene(side=3).appended(beside))
    assert mirrored(light).any() and not mirrored(light.through_glass).any()


def test_gloss_that_is_seen_shows_lamps_behind_a_pane():
    """As bounced light, which it is in Cycles."""
    scene, pane = floor_scene(side=3), red_glass((0.25, 0.25), (0.2, 0.2))
    scene.tiles[:, ROUGHNESS] = 0.3
    bare, behind = (estimate_light(scene_light(lit), *floor_view(16, 16)) for lit in (scene, scene.appended(pane)))
    shown, passed = bare.direct[0, LOBES.index("glossy")], (behind.reflected - bare.reflected)[0]
    bright = shown[0] > 0.2 * shown[0].max()
    for channel, share in enumerate(0.96 ** 2 * np.float32(RED)):
        ratio = passed[channel][bright].sum() / shown[channel][bright].sum()
        assert ratio == pytest.approx(share, rel=0.05)
    assert not behind.direct.any()
