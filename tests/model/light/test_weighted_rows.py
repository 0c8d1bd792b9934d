# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums of weighted rows."""
import pytest
import torch

from renderformer_v2.model.light.weighted_rows import weighted_rows


@pytest.mark.parametrize("places, rows", [(5, 3), (5, 1), (0, 4)])
def test_they_are_those_of_the_selected_rows(places, rows):
    table, weight = torch.rand(7, 4), torch.rand(places, rows)
    row = torch.randint(7, (places, rows))
    torch.testing.assert_close(weighted_rows(table, row, weight), (table[row] * weight[..., None]).sum(1))


def test_a_table_may_be_a_view():
    table, row = torch.rand(4, 7).T[:, 1:3], torch.tensor([[6, 0]])
    torch.testing.assert_close(weighted_rows(table, row, torch.ones(1, 2)), table[[6]] + table[[0]])
