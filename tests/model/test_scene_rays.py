# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays meet the real surfaces, of the kinds that they ask for, in whatever frame they are."""
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.scene import IOR, TRANSMISSION, Geometry, RenderScene
from renderformer_v2.model.scene_rays import TreeCache, scene_rays
from renderformer_v2.model.surface_kinds import (
    ALL,
    BENDING,
    BOUNCED,
    OCCLUDING,
    REFLECTING,
    SEEN,
    SOLID,
    STRAIGHT_THROUGH,
    Kind,
    Ray,
    token_kinds,
)
from tests.model.samples import flat, floor_scene

SQUARE = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
DOWN = np.float32([(0, 0, -1)])


def at_height(z: float, color=(0.5, 0.5, 0.5), **material: float) -> RenderScene:
    scene = flat(SQUARE + np.float32((0, 0, z)), color)
    for channel, value in (("transmission", TRANSMISSION), ("ior", IOR)):
        if channel in material:
            scene.tiles[:, value] = material[channel]
    return scene


def layers() -> RenderScene:
    """From below: opaque, glass, a cut-out, a shining surface, a lamp, its black back, and one that no camera sees."""
    shining, lamp = at_height(4), at_height(5)
    for scene in (shining, lamp):
        scene.emission[:] = 3
    hidden = [replace(scene, seen=np.zeros(2, bool)) for scene in (lamp, at_height(6, (0, 0, 0)), at_height(7))]
    return at_height(1).appended(at_height(2, transmission=1, ior=1.5), at_height(3, transmission=1, ior=1.0), shining,
                                 *hidden)


@pytest.mark.parametrize("kinds, height", [
    (ALL, 7), (SEEN, 4), (SOLID, 7), (BENDING, 2), (OCCLUDING & ~Kind.UNSEEN, 2), (Kind.LAMP, 5), (Kind.BACK, 6),
    (REFLECTING & ~Kind.UNSEEN, 4), (OCCLUDING | STRAIGHT_THROUGH, 7), (Kind.OPAQUE | Kind.EMITTER, 4)])
def test_rays_meet_the_first_surface_of_the_kinds_that_they_ask_for(kinds, height):
    rays = scene_rays(layers()).among(kinds, Ray.CAMERA)
    hits = rays.closest(np.float32([(0.3, 0.1, 10)]), DOWN)
    assert 10 - hits.distance[0] == pytest.approx(height) and hits.triangle[0] // 2 == height - 1
    assert rays.blocked(np.float32([(0.3, 0.1, 10)]), DOWN, 10.1 - height).all()
    assert not rays.blocked(np.float32([(0.3, 0.1, 10)]), DOWN, 9.9 - height).any()


def test_every_surface_is_of_one_kind():
    assert [Kind(int(kind)).name for kind in token_kinds(layers())[::2]] == [
        "OPAQUE", "GLASS", "CUTOUT", "EMITTER", "LAMP", "BACK", "UNSEEN"]


@pytest.mark.parametrize("clear, transmission, ior, kind", [
    (0.3, 0.3, 1.4, Kind.CUTOUT), (0.8, 0.9, 1.1, Kind.CUTOUT), (0.01, 0.01, 1.4, Kind.OPAQUE),
    (0.1, 0.9, 1.4, Kind.GLASS)])
def test_a_surface_that_more_light_passes_straight_than_bent_is_cut_out(clear, transmission, ior, kind):
    """Whatever the IOR in between is, of a leaf and of the holes in its card."""
    scene = at_height(1, transmission=transmission, ior=ior)
    scene.clear = np.full((len(scene.tiles), 3), clear, np.float32)
    assert (token_kinds(scene) == int(kind)).all()


def test_rays_pass_the_surfaces_that_are_hidden_from_them():
    upper = replace(at_height(2), hidden=np.full(2, Ray.SHADOW | Ray.DIFFUSE, np.uint8))
    rays = scene_rays(at_height(1).appended(upper))
    above = np.float32([(0.3, 0.1, 3)])
    distances = [rays.among(SOLID, ray).closest(above, DOWN).distance[0]
                 for ray in (Ray.CAMERA, Ray.GLOSSY, Ray.SHADOW, Ray.DIFFUSE, BOUNCED)]
    assert distances == pytest.approx([1, 1, 2, 2, 1])
    assert len(rays.rows(SOLID, Ray.DIFFUSE)) == 2 and len(rays.rows(SOLID, BOUNCED)) == 4


def test_without_surfaces_nothing_is_met():
    rays = scene_rays(RenderScene()).among(ALL, Ray.CAMERA)
    assert rays.closest(np.zeros((2, 3)), np.ones((2, 3))).triangle.tolist() == [-1, -1]
    assert not rays.blocked(np.zeros((2, 3)), np.ones((2, 3))).any()


def test_a_normalised_scene_uses_the_same_trees_in_its_own_units():
    world = replace(at_height(100.0), box=np.float32([(-50, -50, 90), (50, 50, 110)]))
    frame = Normalization.of(world)
    assert frame.scale == pytest.approx(0.01)
    before, after = scene_rays(world), scene_rays(frame.scene(world))
    assert before.trees is after.trees
    eye = np.float32([(0.3, 0.1, 103)])
    for rays, origin, distance in ((before, eye, 3.0), (after, frame.points(eye), 0.03)):
        hits = rays.among(ALL, Ray.CAMERA).closest(origin, DOWN)
        assert hits.distance[0] == pytest.approx(distance, rel=1e-4) and hits.triangle[0] >= 0
        assert rays.among(ALL, Ray.CAMERA).blocked(origin, DOWN, 1.01 * distance).all()
        assert not rays.among(ALL, Ray.CAMERA).blocked(origin, DOWN, 0.99 * distance).any()


def test_rays_meet_the_geometry_and_not_the_tokens():
    scene = floor_scene()
    bumpy = scene.surfaces.triangles[:-1].copy()
    bumpy[..., 2] += 0.25
    geometry = Geometry(bumpy, scene.normals[:-1], np.arange(len(bumpy), dtype=np.int32))
    rays = scene_rays(replace(scene, geometry=geometry)).among(ALL, Ray.CAMERA)
    hits = rays.closest(np.float32([(0.3, 0.1, 1)]), DOWN)
    assert hits.distance[0] == pytest.approx(0.75)


def test_appended_scenes_keep_their_geometry_and_its_tokens():
    fine = flat(np.concatenate([SQUARE, SQUARE + np.float32((0, 0, 1))]), (0.2, 0.2, 0.2))
    coarse = replace(flat(SQUARE[:1], (0.2, 0.2, 0.2)),
                     geometry=Geometry(fine.triangles, fine.normals, np.zeros(4, np.int32)))
    joined = floor_scene(side=1).appended(coarse)
    joined.validate()
    assert len(joined.geometry) == 3 + 4 and joined.geometry.token.tolist() == [0, 1, 2, 3, 3, 3, 3]
    with pytest.raises(ValueError, match="geometry.token reaches outside the 1 triangles"):
        replace(coarse, geometry=replace(coarse.geometry, token=np.ones(4, np.int32))).validate()


def moved_triangles(scene: RenderScene, rows, by) -> RenderScene:
    triangles = scene.triangles.copy()
    triangles[rows] += np.float32(by)
    return replace(scene, triangles=triangles)


def test_trees_of_what_was_not_edited_are_used_again():
    rng, cache = np.random.default_rng(0), TreeCache()
    corners = rng.uniform(-1, 1, (400, 1, 3)) + rng.normal(0, 0.1, (400, 3, 3))
    first = flat(corners.astype(np.float32), (0.5, 0.5, 0.5))
    versions = [first, moved_triangles(first, slice(20, 60), (0.1, 0, 0)), moved_triangles(first, slice(20, 60), 0.2),
                moved_triangles(first, slice(30, 400), 0.3)]
    origin, direction = rng.uniform(-1, 1, (2, 500, 3)).astype(np.float32)
    trees = []
    for scene in versions:
        cached, fresh = scene_rays(replace(scene), cache), scene_rays(scene)
        assert_array_equal(cached.among(ALL, Ray.CAMERA).closest(origin, direction).triangle,
                           fresh.among(ALL, Ray.CAMERA).closest(origin, direction).triangle)
        assert_array_equal(cached.among(ALL, Ray.CAMERA).blocked(origin, direction, 0.5),
                           fresh.among(ALL, Ray.CAMERA).blocked(origin, direction, 0.5))
        trees.append([rays for _, rays in cached.trees.of(Kind.OPAQUE, 0)])
    assert [len(each) for each in trees] == [1, 2, 2, 1]
    assert trees[1][0] is trees[2][0] and trees[1][1] is not trees[2][1]
    unchanged = scene_rays(replace(versions[3]), cache)
    assert [rays for _, rays in unchanged.trees.of(Kind.OPAQUE, 0)] == trees[3]
