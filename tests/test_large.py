# SPDX-License-Identifier: GPL-3.0-or-later
"""Large scenes and large pictures: what is made of them, and how much memory that takes at most."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PEAK = """
import json, os, resource, sys
import tools

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10  # Linux counts in KiB

def say(**found):
    print(json.dumps(found))
    sys.stdout.flush()
    os._exit(0)
"""
MILLION = PEAK + """
import bpy
import numpy as np
from examples.effects import empty
from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from renderformer_v2.rf2_engine.convert.report import Report
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
made = convert(depsgraph, view, token_budget=4096, max_edge=0.2, report=Report()).triangles
a, b, c = corners[faces[:, 0]], corners[faces[:, 1]], corners[faces[:, 2]]
exact = 2 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
area = np.linalg.norm(np.cross(made[:, 1] - made[:, 0], made[:, 2] - made[:, 0]), axis=1).sum()
say(before=2 * len(faces), after=len(made), area=float(area / exact), low=made.min((0, 1)).tolist(),
    high=made.max((0, 1)).tolist(), memory=peak() - before)
"""
LARGE = PEAK + """
import numpy as np
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
say(shape=picture.shape, finite=bool(np.isfinite(picture).all()), mean=float(coarse.mean()),
    off=float(np.median(inside)), memory=memory)
"""
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems count memory in other units")


def said(program: str) -> dict:
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@needs_linux
def test_a_million_triangles_become_as_many_as_the_network_takes():
    found = said(MILLION)
    assert found["before"] == 999_698 and 3000 < found["after"] <= 4096
    assert found["area"] == pytest.approx(1, abs=0.03)
    assert found["low"] == pytest.approx([-3, -3, -0.2], abs=0.02)
    assert found["high"] == pytest.approx([3, 3, 0.2], abs=0.02)
    assert found["memory"] < 1e9


@pytest.mark.slow
@needs_linux
def test_a_picture_of_4096_by_2160_pixels_is_as_a_small_one_and_takes_less_than_7_gigabytes():
    found = said(LARGE)
    assert found["shape"] == [2160, 4096, 3] and found["finite"]
    assert found["off"] < 0.02 * found["mean"]
    assert found["memory"] < 7e9
