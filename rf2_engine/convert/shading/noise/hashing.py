# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of lattice points: Jenkins' lookup3 (1 to 4 integers), and PCG (Jarzynski and Olano 2020; 2 to 4 integers)."""
from __future__ import annotations

import numpy as np

FINAL = ((2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24))  # target, source, turn
MIX = ((0, 2, 1, 4), (1, 0, 2, 6), (2, 1, 0, 8), (0, 2, 1, 16), (1, 0, 2, 19), (2, 1, 0, 4))  # and what is added
LARGEST = np.float32(0xffffffff)
PCG_FACTOR, PCG_STEP, PCG_MASK = np.int32(1664525), np.int32(1013904223), np.int32(0x7fffffff)
PCG_ROUND = {2: ((0, 1, None), (1, 0, None)), 3: ((0, 1, 2), (1, 2, 0), (2, 0, 1)),
             4: ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2))}  # target, and the two whose product is added


def jenkins(*keys) -> np.ndarray:
    """u32 hash of one to four arrays of integers."""
    start = np.uint32((0xdeadbeef + 4 * len(keys) + 13) & 0xffffffff)
    keys = np.broadcast_arrays(*(np.asarray(key).astype(np.uint32) for key in keys))
    words = [key + start for key in keys[:3]]
    words += [np.full_like(words[0], start) for _ in range(3 - len(words))]
    with np.errstate(over="ignore"):
        if len(keys) == 4:
            for target, source, other, turn in MIX:
                words[target] = (words[target] - words[source]) ^ _turned(words[source], turn)
                words[source] = words[source] + words[other]
            words[0] = words[0] + keys[3]
        for target, source, turn in FINAL:
            words[target] = (words[target] ^ words[source]) - _turned(words[source], turn)
    return words[2]


def _turned(word, turn):
    return (word << np.uint32(turn)) | (word >> np.uint32(32 - turn))


def pcg(cell: np.ndarray) -> np.ndarray:
    """(d, ...) integers, d from 2 to 4 -> (d, ...) f32 from 0 to 1."""
    with np.errstate(over="ignore"):
        words = list(cell.astype(np.int32) * PCG_FACTOR + PCG_STEP)
        for second in (False, True):
            for target, a, b in PCG_ROUND[len(words)]:
                words[target] = words[target] + words[a] * (PCG_FACTOR if b is None else words[b])
            if not second:
                words = [word ^ (word >> np.int32(16)) for word in words]
    return np.stack([word & PCG_MASK for word in words]).astype(np.float32) / np.float32(PCG_MASK)


def hash_floats(*values) -> np.ndarray:
    """f32 from 0 to 1 by the bits of one to four arrays of f32."""
    values = [np.asarray(value, np.float32) for value in np.broadcast_arrays(*values)]
    return jenkins(*(value.view(np.uint32) for value in values)).astype(np.float32) / LARGEST


def hash_point(*values) -> np.ndarray:
    """(d, ...) f32 from 0 to 1 by the bits of d arrays of f32, d from 2 to 4."""
    if len(values) == 4:
        return np.stack([hash_floats(*np.roll(np.broadcast_arrays(*values), i, axis=0)) for i in range(4)])
    return np.stack([hash_floats(*values), *(hash_floats(*values, np.float32(i)) for i in range(1, len(values)))])


def hash_color(*values) -> np.ndarray:
    """(..., 3) f32 from 0 to 1 by the bits of one to four arrays (...) of f32."""
    if len(values) == 4:
        x, y, z, w = values
        return np.stack([hash_floats(x, y, z, w), hash_floats(z, x, w, y), hash_floats(w, z, y, x)], axis=-1)
    return np.stack([hash_floats(*values), *(hash_floats(*values, np.float32(more)) for more in (1, 2))], axis=-1)


def offset(seed: int, dimensions: int) -> np.ndarray:
    """(dimensions,) f32 between 100 and 200, by which a noise is moved to get another one."""
    if dimensions == 1:
        return 100 + 100 * np.atleast_1d(hash_floats(np.float32(seed)))
    return 100 + 100 * hash_floats(np.full(dimensions, seed, np.float32), np.arange(dimensions, dtype=np.float32))
