# SPDX-License-Identifier: GPL-3.0-or-later
"""A Rendered viewport without a window, which looks through the scene's camera or from beside it."""
from __future__ import annotations

import time

import numpy as np


def request_picture(scene, depsgraph, source, size: tuple[int, int], pose: np.ndarray, begin: float | None = None):
    """A Request for a viewport Session: a picture of `size` (width, height) with the lens of the scene's camera.

    source: a viewport Source that is up to date. pose: camera-to-world (4, 4). begin: seconds of time.perf_counter at
    which the view changed, now if not given.
    """
    from renderformer_v2.rf2_engine.viewport.pictures import ViewportSettings
    from renderformer_v2.rf2_engine.viewport.region_view import RegionView
    from renderformer_v2.rf2_engine.viewport.session import Request
    width, height = size
    projection = scene.camera.evaluated_get(depsgraph).calc_matrix_camera(depsgraph, x=width, y=height)
    view = RegionView(_to_tuples(projection), _to_tuples(pose), (0, width, 0, height), size)
    return Request(source.copied, source.state, view, ViewportSettings.read(scene, depsgraph.view_layer),
                   time.perf_counter() if begin is None else begin)


def read_camera_pose(scene, depsgraph) -> np.ndarray:
    """(4, 4) camera-to-world of the scene's camera."""
    return np.array(scene.camera.evaluated_get(depsgraph).matrix_world)


def _to_tuples(matrix) -> tuple:
    return tuple(map(tuple, np.array(matrix).tolist()))
