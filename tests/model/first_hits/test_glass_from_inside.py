# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass seen from its inside reflects what Fresnel says, beyond the critical angle all light."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.scene import IOR, TRANSMISSION, RenderScene
from tests.model.samples import floor_scene, floor_view

CRITICAL = np.sqrt(1 - 1 / 1.33 ** 2)  # cosine


def surface(turned: bool) -> RenderScene:
    """Of water, seen from above, where there is air or, `turned`, water."""
    scene = floor_scene()
    scene.tiles[:, TRANSMISSION], scene.tiles[:, IOR], scene.tiles[:, :3] = 1, 1.33, 1
    if turned:
        scene.triangles[:], scene.normals[:] = scene.triangles[:, ::-1].copy(), -scene.normals
    return scene


@pytest.fixture
def wide():
    """A view of the floor with pixels at all angles up to 77 degrees."""
    view, _ = floor_view(32, 32)
    view.camera_to_world[2, 3], view.focal[:] = 0.3, 10.0
    return view


def test_from_below_water_reflects_all_beyond_the_critical_angle_and_little_before(wide):
    guides = cast_guides(surface(turned=True), wide)
    hit = guides.hit_triangle >= 0
    cosine = (0.3 / np.linalg.norm(guides.position - wide.camera_to_world[:3, 3], axis=-1))[hit]
    glossy, transmission = guides.glossy_color[hit], guides.transmission_color[hit]
    beyond, before = cosine < CRITICAL - 0.01, cosine > 0.9
    assert beyond.sum() > 100 and before.sum() > 20
    np.testing.assert_allclose(glossy[beyond], 1, atol=1e-5)
    np.testing.assert_allclose(transmission[beyond], 0, atol=1e-5)
    np.testing.assert_allclose(glossy[before], 0.02, atol=0.02)
    np.testing.assert_allclose((glossy + transmission)[before], 1, atol=1e-5)


def test_from_above_it_stays_as_it_was(wide):
    guides = cast_guides(surface(turned=False), wide)
    assert (guides.glossy_color[guides.hit_triangle >= 0] < 0.1).all()
