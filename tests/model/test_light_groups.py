# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of groups: a scene with some of its lights, and shares of a picture that sum to it."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model import light_groups
from renderformer_v2.model.light_passes import Lobes
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE, Guides
from renderformer_v2.model.scene_rays import scene_rays
from tests.model.samples import floor_scene

H, W = 12, 20


@pytest.fixture
def scene():
    """Two lights, of the groups 1 and 0, and an environment of group 2."""
    scene = floor_scene()
    group = np.zeros(len(scene), np.int32)
    scene.emission[:] = 0
    scene.emission[0], scene.emission[1], group[0] = 5, 3, 1
    return replace(scene, light_group=group, environment=np.ones(ENVIRONMENT_SHAPE, np.float32),
                   environment_group=np.array([2], np.int32))


def test_a_scene_is_lit_by_one_group_and_keeps_its_rays(scene):
    lit = [light_groups.lit_by(scene, group) for group in range(4)]
    assert [len(np.flatnonzero(one.is_light)) for one in lit] == [1, 1, 0, 0]
    assert [one.environment is not None for one in lit] == [False, False, True, False]
    assert [light_groups.has_lights(scene, group) for group in range(4)] == [True, True, True, False]
    np.testing.assert_array_equal(sum(one.emission for one in lit), scene.emission)
    assert all(scene_rays(one).trees is scene_rays(scene).trees for one in lit)


def test_groups_stay_with_their_triangles_when_scenes_are_joined(scene):
    ungrouped = replace(scene, light_group=None)
    joined = ungrouped.appended(scene, ungrouped)
    assert np.flatnonzero(joined.light_group).tolist() == [len(scene)]
    assert ungrouped.appended(ungrouped).light_group is None
    joined.validate()


def picture(rng, **traced):
    dark = np.zeros((H, W, 3), np.float32)
    flat = np.zeros((H, W), np.float32)
    return Guides(dark, dark, dark, dark, dark, emission=rng.random((H, W, 3), np.float32),
                  environment=rng.random((H, W, 3), np.float32), depth=flat, alpha=flat,
                  hit_triangle=flat.astype(np.int32), hit_barycentric=np.zeros((H, W, 2), np.float32), **traced)


@pytest.mark.parametrize("is_traced", [True, False])
@pytest.mark.parametrize("with_environment", [True, False])
def test_groups_and_the_rest_make_the_picture(scene, is_traced, with_environment):
    rng = np.random.default_rng(1)
    parts = rng.random((3, H, W, 3), np.float32) * is_traced  # traced, of no group and of two
    guides = picture(rng, **({"traced": parts.sum(0)} if is_traced else {}))
    emitted = np.stack([0 * guides.emission, guides.emission, 0 * guides.emission])
    sampled = parts + emitted
    sampled[2] += guides.environment
    estimates = rng.random((3, H, W, 3), np.float32)
    lobes = Lobes(parts.sum(0) + estimates.sum(0), guides.traced, groups=estimates)
    shown = lobes.radiance + guides.emission + with_environment * guides.environment
    light = light_groups.divide(2 * shown, guides, lobes, sampled[1:], guides, scene, with_environment)
    assert light.min() >= 0
    rest = 2 * shown - light.sum(0)
    expected = 2 * (parts[0] + estimates[0])
    assert rest.mean() == pytest.approx(expected.mean(), rel=0.05)
    of_key = 2 * (parts[1] + estimates[1] + guides.emission)
    assert light[0].mean() == pytest.approx(of_key.mean(), rel=0.05)
    without_rest = replace(scene, light_group=np.ones(len(scene), np.int32))
    lobes = replace(lobes, groups=estimates * np.array([0, 1, 1], np.float32)[:, None, None, None])
    light = light_groups.divide(shown, guides, lobes, sampled[1:], guides, without_rest, with_environment)
    np.testing.assert_allclose(light.sum(0), shown, rtol=1e-4, atol=1e-5)


def test_light_that_no_estimate_tells_belongs_to_groups_where_all_that_shines_is_in_one(scene):
    scene = replace(scene, light_group=np.ones(len(scene), np.int32))
    guides = picture(np.random.default_rng(2))
    guides.emission[:, :] = guides.environment[:] = 0
    estimates = np.zeros((3, H, W, 3), np.float32)
    estimates[1, :, :W // 2], estimates[2, :, :W // 2] = 3, 1
    shown = np.ones((H, W, 3), np.float32)
    light = light_groups.divide(shown, guides, Lobes(shown, groups=estimates), 0 * estimates[1:], guides, scene, True)
    np.testing.assert_allclose(light[0], 0.75, rtol=1e-4)
    np.testing.assert_allclose(light.sum(0), shown, rtol=1e-4)
