# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits by rays have colours as Cycles' passes have them, by the angle of the view."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.material.reflectance import fresnel
from renderformer_v2.model.material.sheen import albedo, mean_albedo
from renderformer_v2.model.scene import IOR, METALLIC, ROUGHNESS
from tests.model.samples import floor_scene, floor_view

HEIGHT = 0.3  # of the camera above the floor
BASE = np.float32((0.8, 0.5, 0.2))


@pytest.fixture
def wide():
    """A view of the floor with pixels at all angles up to 77 degrees."""
    view, _ = floor_view(32, 32)
    view.camera_to_world[2, 3], view.focal[:] = HEIGHT, 10.0
    return view


def seen(scene, view):
    """Diffuse and glossy colours of pixels that show the floor, by the cosine of their view."""
    guides = cast_guides(scene, view)
    hit = (guides.hit_triangle >= 0) & (guides.emission == 0).all(-1)
    cosine = (HEIGHT / np.linalg.norm(guides.position - view.camera_to_world[:3, 3], axis=-1))[hit]
    order = np.argsort(cosine)
    assert np.ptp(cosine) > 0.5
    return cosine[order], *(getattr(guides, f"{name}_color")[hit][order] for name in ("diffuse", "glossy"))


def test_a_layer_reflects_more_towards_grazing_angles_and_what_is_below_it_less(wide):
    scene = floor_scene()
    scene.tiles[:, IOR], scene.tiles[:, ROUGHNESS] = 1.3291, 0.1  # as IOR 1.5 at Specular IOR Level 0.5
    cosine, diffuse, glossy = seen(scene, wide)
    layer = fresnel(cosine, np.float32(1.5))
    np.testing.assert_allclose(glossy[:, 0], layer, rtol=0.1, atol=0.005)
    np.testing.assert_allclose(diffuse, BASE * (1 - layer[:, None]), rtol=0.03)


def test_a_metal_gets_white_towards_grazing_angles(wide):
    scene = floor_scene()
    scene.tiles[:, METALLIC], scene.tiles[:, ROUGHNESS] = 1, 0.1
    cosine, diffuse, glossy = seen(scene, wide)
    np.testing.assert_allclose(glossy, BASE + (1 - BASE) * (1 - cosine[:, None]) ** 5, atol=0.03)


@pytest.mark.parametrize("single, measured", [(0, (0.314, 0.106, 0.052)), (1, (0.228, 0.094, 0.048))])
def test_rough_metal_loses_what_its_facets_hide_from_each_other(wide, single, measured):
    """Measured in Cycles, at a cosine of 0.479, with distributions with and without multiple scattering."""
    scene = floor_scene()
    scene.tiles[:, :3] = np.float16((0.5, 0.2, 0.1))[:, None, None]
    scene.tiles[:, METALLIC], scene.tiles[:, ROUGHNESS] = 1, 1
    scene.single = np.full(len(scene.tiles), single, np.float32)
    cosine, _, glossy = seen(scene, wide)
    near = np.abs(cosine - 0.479) < 0.05
    assert near.sum() > 10
    np.testing.assert_allclose(glossy[near].mean(0), measured, atol=0.015)


def test_rough_metal_that_reflects_more_than_arrives_stays_bright(wide):
    scene = floor_scene()
    scene.tiles[:, :3], scene.tiles[:, METALLIC], scene.tiles[:, ROUGHNESS] = 4, 1, 1
    assert (seen(scene, wide)[2] > 1).all()


def test_a_coat_is_above_what_it_covers(wide):
    """Half a coat of f0 0.04 on a metal, whose tile has its roughness in part."""
    scene = floor_scene()
    scene.tiles[:, METALLIC], scene.tiles[:, ROUGHNESS] = 1, 0.29
    scene.coat = np.float32([(0.5, 0.04, 0.1, 0.05)])
    cosine, diffuse, glossy = seen(scene, wide)
    of_coat = 0.5 * fresnel(cosine[:, None], np.float32(1.5))
    above = cosine > 0.5
    np.testing.assert_allclose(glossy[above], (of_coat + (1 - of_coat) * BASE)[above], atol=0.03)


def test_sheen_is_what_it_is_in_each_pixels_view(wide):
    scene = floor_scene()
    scene.tiles[:, IOR] = 1
    color, roughness = np.float32((0.2, 0.5, 0.8)), np.float32(0.6)
    _, without, _ = seen(scene, wide)
    scene.sheen = np.float32([(*color, roughness)])
    cosine, diffuse, _ = seen(scene, wide)
    expected = albedo(cosine, roughness) - mean_albedo(roughness[None])
    np.testing.assert_allclose(diffuse - without, np.outer(expected, color), atol=3e-3)
