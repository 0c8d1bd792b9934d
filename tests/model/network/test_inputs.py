# SPDX-License-Identifier: GPL-3.0-or-later
"""What mappers are given of material tiles."""
import numpy as np
import torch

from renderformer_v2.model.network.inputs import material_tiles
from renderformer_v2.model.scene import constant_tile


def test_no_mapper_is_given_a_color_above_one():
    tiles = torch.from_numpy(np.stack([constant_tile((0.5, 1, 1)), constant_tile((0.5, 1.5, 40))])).float()
    before, given = tiles.clone(), []
    made = material_tiles(tiles, lambda parameters: given.append(parameters) or parameters[..., :1].expand(-1, -1, 9))
    assert torch.equal(given[0][0], given[0][1]) and torch.equal(made[0], made[1])
    assert torch.equal(tiles, before)
