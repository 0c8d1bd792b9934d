# SPDX-License-Identifier: GPL-3.0-or-later
"""Divide triangles that are large for the network or in the picture (docs/scene-input.md 2.3)."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....model import progress
from ....model.geometry import contracted
from ....model.normalize import Normalization
from ..data import mesh as meshes
from ..data.collected import Part
from ..data.mesh import TriangleMesh
from ..meshes import subdivide
from .apparent_size import ApparentSize

BATCH = 100_000  # triangles between two checks of Esc
TURNED = 0.05  # difference of unit normals within a triangle, from which on it stands for a curved surface
TEXTURED = 3.0  # factor on the size of a triangle whose material has to fit into 32 x 32 texels


@dataclass
class Sizes:
    """Sizes of triangles in the network's box, outside of which space is contracted, and in the picture.

    max_edge: target for the longest edge, a fraction of the box and, with `apparent`, of the picture. frame: world to
    box.
    """

    max_edge: float
    frame: Normalization
    apparent: ApparentSize | None

    def find_targets(self, parts: list[Part], budget: int) -> np.ndarray:
        """(k,) how many triangles each part would have if those that look large were divided to `max_edge`."""
        counts = np.array([len(part.mesh) for part in parts], np.int64)
        coarse = [i for i, part in enumerate(parts) if counts[i] * len(part.matrices) <= budget and not part.emits]
        if self.apparent is None or not coarse:
            return counts
        batch = np.cumsum(counts[coarse]) // BATCH
        for some in np.split(np.array(coarse), np.flatnonzero(np.diff(batch)) + 1):
            progress.report()
            corners, gain = self._largest_instances([parts[i] for i in some])
            longest, more = meshes.longest_edges(corners), np.zeros(len(corners))
            large = np.flatnonzero(self.apparent.largest(longest) * gain > self.max_edge)
            size = self.apparent.size(corners[large], longest[large]) * gain[large]
            more[large] = np.maximum(np.square(size / self.max_edge) - 1, 0)
            begin = np.cumsum(counts[some]) - counts[some]
            counts[some] += np.add.reduceat(more, begin).clip(0, budget).astype(np.int64)
        return counts

    def subdivide(self, parts: list[Part], budget: int) -> None:
        """Split large triangles of all parts together, so that the largest of the whole scene come first."""
        if not parts:
            return
        counts = np.array([len(part.mesh) for part in parts])
        copies = np.array([len(part.matrices) for part in parts])
        cost = np.where([part.emits for part in parts], 0, copies)
        corners = np.concatenate([self.frame.points(self._corners(part, _largest(part, self._reach)))
                                  for part in parts])
        apparent_sizes = None
        if self.apparent is not None:
            nearest, gain = self._largest_instances(parts)

            def apparent_sizes(weights: np.ndarray, parent: np.ndarray) -> np.ndarray:
                pieces = weights @ nearest[parent]
                return self.apparent.size(pieces, meshes.longest_edges(pieces)) * gain[parent]
        parent, weights = subdivide.subdivide(corners, np.repeat(cost, counts), self.max_edge,
                                              budget - int(counts @ copies), contracted, apparent_sizes)
        owner = np.repeat(np.arange(len(parts)), counts)[parent]
        for i, part in enumerate(parts):
            mine = owner == i
            if np.count_nonzero(mine) > counts[i]:
                if part.real is None and not part.is_textured and _is_curved(part.mesh):
                    part.real = part.mesh  # pieces do not tell how far it is from the curved surface
                part.mesh = subdivide.pieces(part.mesh, parent[mine] - counts[:i].sum(), weights[mine])

    def _largest_instances(self, parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3, 3) world corners of the instance of each part that looks largest, and (n,) what their size counts."""
        corners = np.concatenate([self._corners(part, _largest(part, self._distance)) for part in parts])
        gain = [part.is_shown * (TEXTURED if part.is_textured else 1.0) for part in parts]
        return corners, np.repeat(gain, [len(part.mesh) for part in parts])

    @staticmethod
    def _corners(part: Part, matrix: np.ndarray) -> np.ndarray:
        """(n, 3, 3) world corners of one instance."""
        return part.mesh.corners @ matrix[:3, :3].T + matrix[:3, 3]

    def _reach(self, scale: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(m,) how large instances are in the network's contracted space."""
        positions = self.frame.points(middle)
        return scale / np.square(positions).sum(axis=1).clip(1)

    def _distance(self, scale: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(m,) how large instances look."""
        return scale / np.linalg.norm(middle - self.apparent.eye, axis=1).clip(self.apparent.near)


def _largest(part: Part, size) -> np.ndarray:
    """(4, 4) the matrix for which `size` of scales (m,) and middles (m, 3) is largest."""
    matrices = np.array(part.matrices)
    middle = matrices[:, :3, :3] @ part.mesh.corners.mean(axis=(0, 1), dtype=np.float64) + matrices[:, :3, 3]
    return matrices[size(np.linalg.norm(matrices[:, :3, :3], axis=(1, 2)), middle).argmax()]


def _is_curved(mesh: TriangleMesh) -> bool:
    """Whether shading normals vary within triangles."""
    return bool((np.ptp(mesh.normals, axis=1) > TURNED).any())
