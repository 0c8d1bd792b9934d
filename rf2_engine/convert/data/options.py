# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a conversion."""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ConversionOptions:
    """How a scene becomes tokens."""

    token_budget: int  # most triangles of the result, of which lamps take no more than half
    max_edge: float    # longest edge, a fraction of the longest side of the scene's box; farther away it may be longer
    as_is: bool = False  # one unit of the world is one of the network's, around its origin; light keeps its strength
    paper_lamps: bool = False  # each lamp becomes one small triangle (lamps/one_triangle.py)
