# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits without Cycles agree with those that Cycles gives."""
import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import SPREAD, cast_guides
from bl_ext.user_default.renderformer_v2.model.scene import RenderScene, View, constant_tile
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.first_hits import make_guides

from tests.rf2_engine.f12 import cube, material, sun


def test_rays_through_the_tokens_find_what_cycles_finds(scene, monkeypatch):
    seen = {}

    def spy(passes, converted, view):
        seen.update(scene=converted, view=view, guides=make_guides(passes, converted, view))
        return seen["guides"]

    monkeypatch.setattr(first_hits, "make_guides", spy)
    cube(scene, of=material("Red", (0.8, 0.1, 0.1)))
    sun(scene)
    bpy.ops.render.render(scene=scene.name)
    cycles, cast = seen["guides"], cast_guides(seen["scene"], seen["view"])

    covered = (cycles.alpha > 0.5) & (cast.alpha > 0.5)
    assert covered.any() and ((cycles.alpha > 0.5) == (cast.alpha > 0.5)).mean() > 0.97  # one sample at silhouettes
    # A tile's diffuse colour is that of the surface, Cycles' leaves out what the coat of the dielectric reflects.
    for name, tolerance in (("position", 1e-3), ("normal", 1e-3), ("depth", 1e-3), ("diffuse_color", 0.05)):
        difference = np.abs(getattr(cycles, name) - getattr(cast, name))[covered]
        assert np.median(difference) < tolerance and difference.mean() < 10 * tolerance, name
    empty = (cycles.alpha < 0.01) & (cast.alpha == 0)
    np.testing.assert_allclose(cast.environment[empty], cycles.environment[empty], atol=1e-3)
    assert (cast.hit_triangle[covered] == cycles.hit_triangle[covered]).mean() > 0.97


def test_a_lamp_is_not_seen_and_an_empty_scene_is_empty(scene, monkeypatch):
    seen = {}
    monkeypatch.setattr(first_hits, "make_guides", lambda passes, converted, view: seen.update(
        scene=converted, view=view) or make_guides(passes, converted, view))
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.location, lamp.rotation_euler = (0, -2, 0), (1.5707963, 0, 3.1415927)
    lamp.data.size = 5
    scene.collection.objects.link(lamp)
    bpy.ops.render.render(scene=scene.name)
    assert seen["scene"].is_light.any()
    guides = cast_guides(seen["scene"], seen["view"])
    assert not guides.alpha.any() and (guides.hit_triangle == -1).all() and guides.environment.min() > 0


def test_several_rays_through_a_pixel_smooth_its_edges_and_keep_one_surface():
    # A wall that covers the left half of the picture and three quarters of the pixels in the middle.
    corners = np.float32([[(-9, 4, -9), (0.25, 4, -9), (0.25, 4, 9)], [(-9, 4, -9), (0.25, 4, 9), (-9, 4, 9)]])
    wall = RenderScene(triangles=corners, normals=np.broadcast_to(np.float32((0, -1, 0)), (2, 3, 3)).copy(),
                       emission=np.zeros((2, 3), np.float32), beam_axis=np.zeros((2, 3), np.float32),
                       beam_cosine=np.zeros((2, 2), np.float32), tile_index=np.zeros(2, np.int32),
                       tiles=constant_tile((0.5, 0.5, 0.5))[None],
                       environment=np.ones((256, 512, 3), np.float32))
    forward = np.float32([(1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)])  # along Y, Z is up
    view = View(forward, np.float32([12, 12]), np.float32([4, 3]), 9, 6)              # a pixel is a third of a unit
    sharp, smooth = cast_guides(wall, view), cast_guides(wall, view, SPREAD)
    assert set(np.unique(sharp.alpha)) == {0, 1}
    np.testing.assert_allclose(smooth.alpha[0], [1, 1, 1, 1, 0.75, 0, 0, 0, 0])
    np.testing.assert_allclose(smooth.environment[..., 0] + smooth.alpha, 1)
    np.testing.assert_allclose(smooth.diffuse_color[0, 4], 0.75 * smooth.diffuse_color[0, 0], rtol=1e-5)
    assert (smooth.hit_triangle >= 0).sum() == (smooth.alpha > 0).sum()
    np.testing.assert_allclose(smooth.position[smooth.alpha > 0][:, 1], 4, rtol=1e-5)
