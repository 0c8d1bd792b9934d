# SPDX-License-Identifier: GPL-3.0-or-later
"""Value nodes against Cycles: one picture of all graphs, and for each its mean error."""
import pytest

from tests.rf2_engine.convert.shading.cases import EVERY, SOME
from tests.rf2_engine.convert.shading.squares import compare, error

MOST = 0.01


def assert_alike(cases, most=MOST):
    wrong = [f"{case}: {error(ours, cycles):.3f} {lines}"
             for case, (ours, cycles, lines) in zip(cases, compare(cases), strict=True)
             if not error(ours, cycles) <= most or bool(lines) != case.is_reported]
    assert not wrong, "\n".join(wrong)


def test_nodes_have_cycles_values():
    assert_alike(SOME)


@pytest.mark.slow
def test_all_modes_of_all_nodes_have_cycles_values():
    assert_alike(EVERY)
