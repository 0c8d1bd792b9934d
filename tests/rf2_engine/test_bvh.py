# SPDX-License-Identifier: GPL-3.0-or-later
"""Where Embree is absent, Blender's trees give the same answers."""
import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.model import rays
from bl_ext.user_default.renderformer_v2.rf2_engine.bvh import BlenderRays
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, press_f12, sun


def test_blender_and_embree_meet_the_same():
    rng = np.random.default_rng(1)
    triangles = np.float32(rng.uniform(-1, 1, (400, 1, 3)) + rng.normal(0, 0.15, (400, 3, 3)))
    origin, direction = np.float32(rng.uniform(-1, 1, (2000, 3))), np.float32(rng.normal(size=(2000, 3)))
    embree, blender = rays.Rays(triangles).closest(origin, direction), BlenderRays(triangles).closest(origin, direction)
    same = embree.triangle == blender.triangle
    assert same.mean() > 0.998 and 0.2 < (embree.triangle >= 0).mean() < 0.95
    np.testing.assert_allclose(embree.distance[same], blender.distance[same], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(embree.weights[same], blender.weights[same], atol=5e-3)
    reach = np.float32(rng.uniform(0, 1, 2000))
    assert (rays.Rays(triangles).blocked(origin, direction, reach)
            == BlenderRays(triangles).blocked(origin, direction, reach)).mean() > 0.998


def test_a_render_without_embree_is_the_same_picture_and_says_so(scene, tmp_path, monkeypatch):
    cube(scene)
    sun(scene)
    scene.render.resolution_percentage = 50
    with_embree = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert not any("embreex" in line for line in last_render.last_frame[0].report)
    monkeypatch.setattr(rays, "has_embree", lambda: False)
    bpy.data.objects["Cube"].location.x += 1e-7  # so that the scene is converted and encoded again
    without = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    np.testing.assert_allclose(without, with_embree, atol=0.02)
    assert sum("embreex" in line for line in last_render.last_frame[0].report) == 1
