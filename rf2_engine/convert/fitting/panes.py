# SPDX-License-Identifier: GPL-3.0-or-later
"""Find panes of glass and transparent cards close to the camera, to look through them."""
from __future__ import annotations

import numpy as np

from ....model.geometry import area_vectors
from ..data.collected import Part
from ..data.report import Report
from ..shading.material import MaterialTiles

FLAT = 0.9     # length of the mean of the unit normals, either side up, of a pane: curved ones too, but no vessel
CLEAR = 0.5    # of the light that goes through a pane
SMOOTH = 0.3   # roughness up to which glass shows what is behind it
SAMPLE = 64    # triangles that tell


def is_pane(part: Part) -> bool:
    """Whether a part is about flat, and what is behind it shows."""
    some = part.mesh.take(np.linspace(0, len(part.mesh) - 1, min(SAMPLE, len(part.mesh))).astype(int))
    normals = area_vectors(some.corners.astype(np.float64))
    largest = normals[np.square(normals).sum(axis=1).argmax()]
    aligned = normals * np.where(normals @ largest < 0, -1, 1)[:, None]
    if np.linalg.norm(aligned.sum(axis=0)) < FLAT * np.linalg.norm(normals, axis=1).sum():
        return False
    tiles = MaterialTiles(Report())
    shares = [tiles.shows_through(part.materials[slot], some.take(some.slot == slot), part.places[0], SMOOTH)
              for slot in np.unique(some.slot)]
    return bool(np.mean(np.concatenate(shares)) > CLEAR)
