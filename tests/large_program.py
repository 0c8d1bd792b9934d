# SPDX-License-Identifier: GPL-3.0-or-later
"""What test_large.py has a process of its own do, whose memory is counted: `python -m tests.large_program KIND`."""
import json
import os
import resource
import sys

import numpy as np

import tools  # noqa: F401  makes the package `renderformer_v2` importable


def peak() -> int:
    """Bytes that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10  # Linux counts in KiB


def million_triangles() -> dict:
    """Hills converted for 4096 triangles."""
    import bpy

    from examples.effects import empty
    from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
    from renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
    from renderformer_v2.rf2_engine.convert.data.report import Report
    from renderformer_v2.rf2_engine.convert.scene import convert

    side, scene = 708, empty(0.5)
    x, y = np.meshgrid(*[np.linspace(-3, 3, side, dtype=np.float32)] * 2)
    corners = np.stack([x, y, 0.2 * np.sin(5 * x) * np.cos(4 * y)], -1).reshape(-1, 3)
    at = np.arange(side * side).reshape(side, side)
    faces = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new("Hills")
    mesh.vertices.add(len(corners))
    mesh.vertices.foreach_set("co", corners.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 4))
    mesh.update(calc_edges=True)
    scene.collection.objects.link(bpy.data.objects.new("Hills", mesh))
    depsgraph, before = bpy.context.evaluated_depsgraph_get(), peak()
    view = convert_camera(depsgraph, 64, 64, None)
    made = convert(depsgraph, view, ConversionOptions(4096, 0.2), Report()).triangles
    a, b, c = corners[faces[:, 0]], corners[faces[:, 1]], corners[faces[:, 2]]
    exact = 2 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    area = np.linalg.norm(np.cross(made[:, 1] - made[:, 0], made[:, 2] - made[:, 0]), axis=1).sum()
    return dict(before=2 * len(faces), after=len(made), area=float(area / exact), low=made.min((0, 1)).tolist(),
                high=made.max((0, 1)).tolist(), memory=peak() - before)


def large_picture() -> dict:
    """A floor of 4096 x 2160 pixels beside one of 256 x 135."""
    from renderformer_v2.model.renderer import Renderer
    from tests.model.samples import floor_scene, floor_view

    scene = floor_scene()
    small, (view, guides) = floor_view(256, 135), floor_view(4096, 2160)
    encoded = Renderer(device="cpu", precision="fp32").encode(scene, 4096)
    before = peak()
    picture = encoded.view(view, guides)
    memory, coarse = peak() - before, encoded.view(*small)
    means = picture.reshape(135, 16, 256, 16, 3).mean((1, 3))
    inside = np.abs(means - coarse)[2:-2, 2:-2][small[1].alpha[2:-2, 2:-2] > 0]
    return dict(shape=picture.shape, finite=bool(np.isfinite(picture).all()), mean=float(coarse.mean()),
                off=float(np.median(inside)), memory=memory)


if __name__ == "__main__":
    print(json.dumps({"million_triangles": million_triangles, "large_picture": large_picture}[sys.argv[1]]()))
    sys.stdout.flush()
    os._exit(0)
