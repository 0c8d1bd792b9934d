# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a conversion."""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ConversionOptions:
    """token_budget: most triangles of the result, of which lamps take no more than half; max_edge: longest edge, as a
    fraction of the longest side of the scene's box (farther away edges may be longer); as_is: one unit of the world is
    one of the network's, around the world's origin, and light keeps its strength; paper_lamps: each lamp becomes one
    small triangle (lamps/one_triangle.py).
    """

    token_budget: int
    max_edge: float
    as_is: bool = False
    paper_lamps: bool = False
