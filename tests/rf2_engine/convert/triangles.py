# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles without Blender, to be dressed by materials."""
import numpy as np

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.mesh import TriangleMesh

TRIANGLE = ((1, -1, 0), (-1, 1, 0), (-1, -1, 0))  # whose tile shows the square from -1 to 1


def triangles(n, uv=None, attributes=None, active_color=None, corners=TRIANGLE, size=2) -> TriangleMesh:
    """n triangles with (n, 3, 2) `uv` and (n, 3, c) `attributes` by name, in a texture space from -size to size."""
    return TriangleMesh(
        np.tile(np.float32(corners), (n, 1, 1)), np.tile(np.float32((0, 0, 1)), (n, 3, 1)),
        {} if uv is None else {"UVMap": np.float32(uv)}, None if uv is None else "UVMap",
        {name: np.float32(layer) for name, layer in (attributes or {}).items()}, active_color, np.zeros(n, np.int32),
        np.float32([(0, 0, 0), (size, size, size)]))
