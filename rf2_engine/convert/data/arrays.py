# SPDX-License-Identifier: GPL-3.0-or-later
"""Small operations on the values of nodes, arrays (..., 1) or (..., 3)."""
from __future__ import annotations

import numpy as np

TINIEST = 1e-30
UNIT_CUBE = np.indices((2, 2, 2)).reshape(3, 8).T  # (8, 3) i64 corners, the last axis fastest


def join(*parts) -> np.ndarray:
    """Arrays (..., c) side by side in their last axis, whose points are broadcast."""
    shape = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    return np.concatenate([np.broadcast_to(part, shape + part.shape[-1:]) for part in parts], axis=-1)


def divide_safely(a, b) -> np.ndarray:
    """a / b, 0 where b is 0."""
    return np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape, np.float32), where=b != 0)


def mix_values(a, b, share) -> np.ndarray:
    return a + (b - a) * share


def smoothstep(t) -> np.ndarray:
    """Cubic from 0 to 1 where t goes from 0 to 1."""
    t = np.clip(t, 0, 1)
    return t * t * (3 - 2 * t)


def dot(a, b) -> np.ndarray:
    """(..., 1)."""
    return np.sum(a * b, axis=-1, keepdims=True)


def length(a) -> np.ndarray:
    """(..., 1)."""
    return np.sqrt(dot(a, a))


def unit(a) -> np.ndarray:
    """`a` of length 1; 0 stays 0."""
    return divide_safely(a, length(a))
