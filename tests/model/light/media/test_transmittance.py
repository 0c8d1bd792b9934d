# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that volumes take away between surfaces."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.media.transmittance import Fog
from renderformer_v2.model.scene import Volumes, constant_tile
from tests.model.samples import floor_scene

UP = torch.tensor([[0.0, 0.0, 1.0]])


def box(side=(2.0, 2.0, 2.0), euler=(0.0, 0.0, 0.0), absorption=0.0, scattering=0.0) -> Volumes:
    """A full box around the origin, turned about Z; coefficients per network unit."""
    side, euler = np.float32(side), np.float32(euler)
    cells = (np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) / 8 - 0.5
    turn = np.array([[np.cos(euler[2]), -np.sin(euler[2]), 0], [np.sin(euler[2]), np.cos(euler[2]), 0], [0, 0, 1]])
    rows = lambda value: np.broadcast_to(np.float32(value), (512, 3)).copy()  # noqa: E731
    mean_side = np.sqrt((side**2).mean())
    position = ((cells * side) @ turn.T).astype(np.float32)
    return Volumes(np.ones((512, 64), np.float32), position, rows(euler), rows(side), rows(scattering * mean_side),
                   rows(absorption * mean_side))


def passing(volumes: Volumes, begin, end) -> float:
    return Fog(volumes).transmittance(torch.tensor([begin]), torch.tensor([end])).item()


@pytest.mark.parametrize("begin, end, inside", [
    ((-0.4, 0.3, 0.1), (0.5, 0.3, 0.1), 0.9), ((0.9, 0.9, 0.9), (-0.9, -0.9, -0.9), 1.8 * np.sqrt(3)),
    ((1.5, 0.0, 0.0), (1.5, 1.0, 0.0), 0.0), ((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), 1.0)])
def test_a_full_box_takes_light_as_beer_and_lambert_say(begin, end, inside):
    assert passing(box(absorption=0.6), begin, end) == pytest.approx(np.exp(-0.6 * inside), abs=0.04)
    assert passing(box(scattering=0.6), begin, end) == pytest.approx(np.exp(-0.6 * inside), abs=0.04)


def test_coloured_media_take_each_colour_by_its_own_share_at_any_distance():
    absorption = np.float32((0.1, 0.6, 1.2))
    fog = Fog(box(absorption=absorption))
    begin, along = np.float32([(-0.5, 0, 0), (-40, 0, 0)]), np.float32([(1, 0, 0)] * 2)
    shares = fog.along(begin, along, np.float32((0.8, np.inf)))
    np.testing.assert_allclose(shares, np.exp(-absorption * np.float32([[0.8], [2]])), atol=0.03)


def test_a_coloured_pane_within_coloured_media_takes_its_share_of_what_they_leave():
    color = np.float32((0.9, 0.5, 0.1))
    murky = replace(floor_scene(side=3), volumes=box(absorption=np.float32((0.1, 0.6, 1.2))))
    murky.environment = np.ones((4, 8, 3), np.float32)
    pane = floor_scene(side=1)
    pane.triangles[:] = pane.triangles * np.float32((50, 50, 0)) + np.float32((0, 0, 0.5))
    pane.emission[:], pane.tiles[:] = 0, constant_tile(color ** 2, roughness=0.0, transmission=1.0)
    without, found = (DirectLight(scene).visibility(torch.zeros(1, 3), UP) for scene in (murky, murky.appended(pane)))
    for clear, tinted in zip(without, found):
        np.testing.assert_allclose(tinted / clear, [color], rtol=0.02)


def test_a_flat_box_lies_where_it_was_turned_to():
    turned = box(side=(2.0, 0.4, 1.0), euler=(0, 0, np.pi / 2), absorption=1.0)
    assert passing(turned, (0.0, -0.9, 0.0), (0.0, 0.9, 0.0)) == pytest.approx(np.exp(-1.8), abs=0.04)
    assert passing(turned, (-0.3, 0.0, 0.0), (0.3, 0.0, 0.0)) == pytest.approx(np.exp(-0.4), abs=0.04)
    assert passing(turned, (-0.9, 0.0, 0.0), (-0.3, 0.0, 0.0)) == 1


def test_a_volume_darkens_what_lamps_sky_and_other_surfaces_light():
    clear = floor_scene(side=3)
    clear.environment = np.ones((4, 8, 3), np.float32)
    murky = replace(clear, volumes=box(absorption=0.8))
    point = torch.tensor([[0.1, 0.1, 0.0]])
    visible, bounced = [], []
    for scene in (clear, murky):
        direct = DirectLight(scene)
        visible.append(torch.cat(direct.visibility(point, UP)))
        radiosity = Radiosity(scene, direct)
        radiosity.leaving = torch.ones_like(radiosity.leaving)
        bounced.append(radiosity.diffuse(torch.tensor([[0.1, 0.1, 0.6]]), -UP).indirect[0])
    lamp = direct.emitters.shapes.origins.mean(0).norm().item()
    sky, lamps = visible[1] / visible[0]
    assert 0.2 < sky[0] < np.exp(-0.8) + 0.05  # at least a unit of the box above, more aside
    assert lamps[0].item() == pytest.approx(np.exp(-0.8 * min(lamp, 1.0)), abs=0.1)
    assert np.exp(-0.8 * 1.2) < bounced[1][0] / bounced[0][0] < np.exp(-0.8 * 0.6) + 0.02
