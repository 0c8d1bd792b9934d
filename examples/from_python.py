# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures from Python, without Blender: a scene of numpy arrays, the bundled network, an EXR.

    python -m examples.from_python OUT.exr

With the published weights, `Renderer("renderformer-v2").render(read_h5("scene.h5"))` does the same for the scene files
of the authors' code (model/published/h5.py).
"""
from __future__ import annotations

import sys

import numpy as np

import tools  # noqa: F401  makes the package `renderformer_v2` importable
from renderformer_v2.model.camera import square_view
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.scene import RenderScene, View, constant_tile

PIXELS = 128
COLORS = (0.7, 0.7, 0.7), (0.7, 0.15, 0.1), (0.15, 0.5, 0.15)  # of floor and back, left wall, right wall
SQUARE = np.float32([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]])


def build_corner() -> RenderScene:
    """A floor and three walls, two metres wide, each of 128 triangles, under a square lamp."""
    walls = [(0, plane(8, (-1, -1, 0), (2, 0, 0), (0, 2, 0))), (0, plane(8, (-1, 1, 0), (2, 0, 0), (0, 0, 2))),
             (1, plane(8, (-1, -1, 0), (0, 2, 0), (0, 0, 2))), (2, plane(8, (1, 1, 0), (0, -2, 0), (0, 0, 2)))]
    lamp = plane(1, (-0.3, 0.3, 1.9), (0, -0.6, 0), (0.6, 0, 0))
    triangles = np.concatenate([corners for _, corners in walls] + [lamp])
    count = len(triangles)
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    emission = np.zeros((count, 3), np.float32)
    emission[-len(lamp):] = 12.0
    return RenderScene(
        triangles=triangles, normals=np.repeat(normals[:, None], 3, axis=1), emission=emission,
        beam_axis=np.zeros((count, 3), np.float32), beam_cosine=np.zeros((count, 2), np.float32),
        tile_index=np.repeat([tile for tile, _ in walls] + [0], [*(len(c) for _, c in walls), len(lamp)]
                             ).astype(np.int32),
        tiles=np.stack([constant_tile(color) for color in COLORS]))


def plane(side: int, corner, u, v) -> np.ndarray:
    """(2 side^2, 3, 3) f32 triangles of the parallelogram at a corner with edges u and v."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(side), np.arange(side)))
    places = (SQUARE + np.stack([x, y], -1)[:, None, None]).reshape(-1, 3, 2) / side
    return (np.float32(corner) + places @ np.float32([u, v])).astype(np.float32)


def look_into_corner() -> View:
    """A camera in front of the open side, one metre above the floor."""
    camera_to_world = np.eye(4, dtype=np.float32)
    camera_to_world[:3] = np.transpose([(1, 0, 0), (0, 0, 1), (0, -1, 0), (0, -3.5, 1)])  # right, up, backward, place
    return square_view(camera_to_world, 40, PIXELS)


def main(path: str) -> None:
    import OpenEXR

    (picture,) = Renderer().render(build_corner(), [look_into_corner()])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": picture}) as file:
        file.write(path)


if __name__ == "__main__":
    main(*sys.argv[1:])
