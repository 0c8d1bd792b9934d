# SPDX-License-Identifier: GPL-3.0-or-later
"""The glow around a lamp in fog: its falloff and its beam within the cells, and what it sends to surfaces."""
from dataclasses import replace

import numpy as np
import torch

from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.scene import RenderScene
from tests.model.light.direct.test_emitters import ball
from tests.model.light.media.test_transmittance import box
from tests.model.samples import flat, floor_scene

RADIUS, RADIANCE, SCATTERING = 0.01, 1e4, 0.05


def lamp_in_fog(beam=None) -> RenderScene:
    """A small ball that shines in the middle of a thin fog of side 2, and a floor far below."""
    scene = floor_scene(side=3, radiance=0.0)
    scene.triangles = (scene.triangles - np.float32([0, 0, 50])).astype(np.float32)
    lamp = flat(ball((0, 0, 0), RADIUS, 16, 8).astype(np.float32), (0, 0, 0))
    lamp.emission = np.full_like(lamp.emission, RADIANCE)
    if beam is not None:
        lamp.beam_axis = np.tile(np.float32((0, 0, -1)), (len(lamp), 1))
        lamp.beam_cosine = np.tile(np.float32(beam), (len(lamp), 1))
    return replace(scene.appended(lamp), volumes=box(scattering=SCATTERING))


def seen(scene: RenderScene, begins, ends) -> np.ndarray:
    return DirectLight(scene).in_scattering.towards_viewer(*map(torch.tensor, (begins, ends)))[:, 0].numpy()


def test_a_lamp_falls_off_within_a_cell_as_its_distance():
    """A ray beside a point of light, at distances of less than a cell: that angle over the distance."""
    beside = [0.02, 0.04, 0.1, 0.3]
    found = seen(lamp_in_fog(), [(-3.0, 0.0, d) for d in beside], [(3.0, 0.0, d) for d in beside])
    expected = [SCATTERING * RADIANCE * RADIUS ** 2 / 4 * 2 * np.arctan(1 / d) / d for d in beside]
    np.testing.assert_allclose(found, expected, rtol=0.12)


def test_the_glow_ends_at_the_rim_of_a_beam_and_at_a_surface():
    scene = lamp_in_fog(beam=(np.cos(0.4), np.cos(0.38)))
    rows = [(-3.0, 0.36, -1.0), (-3.0, 0.48, -1.0), (-3.0, 0.0, 0.1)]
    within, beyond, above = seen(scene, rows, [(3.0, *row[1:]) for row in rows])
    assert within > 0 and beyond == above == 0
    before = seen(scene, [(-3.0, 0.0, -0.9)], [(-0.45, 0.0, -0.9)])
    assert before == 0


def test_a_narrow_beam_in_fog_lights_a_wall_evenly():
    """Few of the rays of a point find the beam; cells that send out much are looked at by all points."""
    scene = lamp_in_fog(beam=(np.cos(0.12), np.cos(0.1)))
    direct = DirectLight(scene)
    points = torch.cartesian_prod(torch.tensor([0.7]), torch.linspace(-0.1, 0.1, 12), torch.linspace(-0.6, -0.4, 12))
    light = Radiosity(scene, direct).diffuse(points, torch.tensor([[-1.0, 0.0, 0.0]]).expand_as(points)).indirect[:, 0]
    assert light.mean() > 0
    assert light.std() < 0.35 * light.mean()
