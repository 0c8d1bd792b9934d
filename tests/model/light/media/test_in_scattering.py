# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that volumes scatter, to the camera and to surfaces: known amounts in thin and thick fog, and beams in it."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from tests.model.light.media.test_transmittance import box
from tests.model.samples import floor_scene

ACROSS = torch.tensor([[-3.0, 0.2, 0.1]]), torch.tensor([[3.0, 0.2, 0.1]])  # 2 units of a box of side 2


def seen(scene, begin=ACROSS[0], end=ACROSS[1]) -> np.ndarray:
    return DirectLight(scene).in_scattering.towards_viewer(begin, end)[0].numpy()


def foggy(scattering, sky=(0.5, 1.0, 2.0), **options):
    """Nothing but a box of fog below a sky of one colour, very dim lamps, and a floor far below."""
    scene = floor_scene(side=3, radiance=0.0)
    scene.triangles = (scene.triangles - np.float32([0, 0, 50])).astype(np.float32)
    return replace(scene, environment=np.broadcast_to(np.float32(sky), (4, 8, 3)).copy(),
                   volumes=box(scattering=scattering, **options))


def test_thin_fog_in_even_light_shows_that_light_times_its_depth():
    np.testing.assert_allclose(seen(foggy(0.02)), 0.04 * np.float32([0.5, 1, 2]), rtol=0.12)


def test_fog_that_absorbs_shows_less_of_what_is_behind_in_it():
    clear, murky = (seen(foggy(0.05, absorption=absorption))[1] for absorption in (0.0, 2.0))
    assert murky < 0.4 * clear


def test_a_path_ends_at_what_it_hits():
    scene = foggy(0.02)
    half, whole = (seen(scene, end=torch.tensor([[x, 0.2, 0.1]]))[0] for x in (0.0, 3.0))
    assert half == pytest.approx(0.5 * whole, rel=0.1)
    assert seen(scene, *(point + torch.tensor([0, 5.0, 0]) for point in ACROSS)).max() == 0


def test_a_roof_throws_its_shadow_into_the_fog():
    """A sun from straight above, and a roof over the half with x > 0."""
    sun = np.zeros((64, 128, 3), np.float32)
    sun[:3] = 100.0
    scene = replace(foggy(0.05), environment=sun)
    open_air = seen(scene)
    roof = np.float32([[[0, -4, 1.5], [4, -4, 1.5], [4, 4, 1.5]], [[0, -4, 1.5], [4, 4, 1.5], [0, 4, 1.5]]])
    triangles = np.concatenate([roof, scene.triangles[2:]])
    covered = replace(scene, triangles=triangles)
    lit, dark = (seen(covered, *(torch.tensor([[x, 0.2, 0.1]]) for x in ends))[0]
                 for ends in ((-1.5, -0.2), (0.2, 1.5)))
    assert lit > 0.25 * open_air[0] and dark < 0.3 * lit


def test_fog_lights_surfaces_with_about_what_it_takes_from_them():
    """Below an even sky, and nothing but thin fog: what arrives at a surface in it is neither more nor less light."""
    scene = foggy(0.1, sky=(1.0, 1.0, 1.0))
    direct = DirectLight(scene)
    point, up = torch.tensor([[0.1, 0.2, -0.5]]), torch.tensor([[0.0, 0.0, 1.0]])
    from_sky = direct.diffuse(point, up)[0]
    from_fog = Radiosity(scene, direct).diffuse(point, up).indirect[0]
    assert (from_fog > 0.07).all() and (from_sky < 0.93).all()
    torch.testing.assert_close(from_sky + from_fog, torch.ones(3), atol=0.03, rtol=0)


def test_without_fog_there_is_nothing_to_light():
    assert DirectLight(floor_scene(side=3)).in_scattering is None
