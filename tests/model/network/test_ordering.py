# SPDX-License-Identifier: GPL-3.0-or-later
"""The spatial order of tokens."""
import torch

from renderformer_v2.model.network.sequence import hilbert_codes, hilbert_grid, hilbert_order
from tests.model.no_host_copies import NoHostCopies


def test_nothing_has_an_order_too():
    nothing = torch.zeros(0, 3)
    assert hilbert_codes(hilbert_grid(nothing)).shape == (0,) and hilbert_order(nothing).shape == (0,)


def test_sorting_never_waits_for_a_card():
    with NoHostCopies():
        order = hilbert_order(torch.randn(1000, 3))
    assert torch.equal(order.sort().values, torch.arange(1000))


def test_tokens_at_one_place_keep_their_order():
    corners = torch.tensor([[1.0, 1, 1], [0, 0, 0]]).repeat(3, 1)
    assert hilbert_order(corners).tolist() == [1, 3, 5, 0, 2, 4]


def test_neighbours_along_the_curve_are_neighbours_in_space():
    side = torch.arange(16.0)
    grid = torch.cartesian_prod(side, side, side)
    steps = grid[hilbert_order(grid)].diff(dim=0)
    assert (steps.abs().sum(dim=1) == 1).all()
