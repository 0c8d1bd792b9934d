# SPDX-License-Identifier: GPL-3.0-or-later
"""What polished metal shows along glossy lobes: lamps, and what a mirror in its place would show."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE, METALLIC, ROUGHNESS, RenderScene
from tests.model.samples import flat, floor_scene

COLOR = np.float32((0.9, 0.5, 0.1))
SLOPE = np.float32([[(1, -1, 0), (2, -1, 1), (2, 1, 1)], [(1, -1, 0), (2, 1, 1), (1, 1, 0)]])  # rises away from x = 0
NORMAL = np.float32((-1, 0, 1)) / np.float32(np.sqrt(2))
POINT, UP, AHEAD = torch.tensor([[0.0, 0, 0.3]]), torch.tensor([[0.0, 0, 1]]), torch.tensor([[-0.98, 0, 0.199]])


def seen(metallic: float, light: RenderScene, **scene) -> tuple[torch.Tensor, torch.Tensor]:
    """(3,) light of a polished floor that a viewer sees mirror a slope at 45 degrees, and what of it are highlights."""
    slope = replace(flat(SLOPE, COLOR), normals=np.tile(NORMAL, (2, 3, 1)))
    slope.tiles[:, METALLIC], slope.tiles[:, ROUGHNESS] = metallic, 0.1
    whole = replace(slope.appended(light) if light is not None else slope, **scene)
    bounce = Radiosity(whole, DirectLight(whole))
    found = bounce.glossy(POINT, UP, torch.nn.functional.normalize(AHEAD, dim=-1), torch.tensor([0.1]),
                          torch.tensor([1.0]), torch.zeros(1), torch.zeros(1))
    return found.complete[0], found.highlights[0]


def test_metal_shows_the_sky_above_in_its_colour():
    sky = np.zeros(ENVIRONMENT_SHAPE, np.float32)
    sky[:ENVIRONMENT_SHAPE[0] // 4] = 2.0  # around the zenith, to which the slope turns rays from the side
    complete, highlights = seen(1.0, None, environment=sky)
    torch.testing.assert_close(complete, torch.from_numpy(2 * COLOR), rtol=0.02, atol=0)
    assert not highlights.any()


@pytest.mark.parametrize("metallic, is_bright", [(1.0, True), (0.0, False)])
def test_metal_alone_shows_highlights_of_lamps(metallic, is_bright):
    lamp = floor_scene()
    lamp = lamp.triangles[lamp.is_light] + np.float32((2.3, 0, 2.0))  # where the slope turns rays to
    light = replace(flat(lamp, (0, 0, 0)), emission=np.full((1, 3), 40, np.float32))
    complete, highlights = seen(metallic, light)
    assert bool((highlights > 0.1).all()) == is_bright == bool((complete > 0.1).all())
    if is_bright:
        torch.testing.assert_close(highlights / highlights[0], torch.from_numpy(COLOR / COLOR[0]), rtol=0.02, atol=0)
