# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known about shadows without a renderer: closed boxes, open skies, a plate under a lamp."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import area_vectors, unit
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.emitters import gather_emitters
from renderformer_v2.model.light.sampling import r2_starts
from renderformer_v2.model.scene import IOR, TRANSMISSION, RenderScene, constant_tile
from renderformer_v2.model.surface_kinds import Ray
from tests.model.light.direct.test_direct_light import OCTAHEDRON
from tests.model.light.direct.test_emitters import grid, irradiance, lit_by
from tests.model.samples import flat, floor_scene

UP = torch.tensor([[0.0, 0.0, 1.0]])
SQUARE = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
BOX = np.concatenate([np.roll(SQUARE + np.float32((0, 0, z)), axis, axis=-1) for axis in range(3) for z in (-1, 1)])


def under_a_sky(corners: np.ndarray) -> RenderScene:
    n = len(corners)
    rows = np.zeros((n, 3), np.float32)
    return RenderScene(corners, np.zeros((n, 3, 3), np.float32), rows, rows, np.zeros((n, 2), np.float32),
                       np.zeros(n, np.int32), constant_tile((0.8, 0.8, 0.8))[None], np.ones((32, 64, 3), np.float32))


def sky(direct: DirectLight, points: torch.Tensor, normals: torch.Tensor) -> torch.Tensor:
    return direct.visibility(points, normals).sky


def test_no_sky_shines_into_a_closed_box():
    scene = under_a_sky(BOX)
    points = torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) * 1.9 - 0.95
    normals = torch.nn.functional.normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    direct = DirectLight(scene)
    assert sky(direct, points, normals).mean() < 0.01
    assert all(x.mean() < 0.02 for x in Radiosity(scene, direct).diffuse(points, normals)[::2])
    wall = torch.tensor(BOX.mean(axis=1))
    outwards = torch.where(wall.abs() > 0.9, wall, 0.0)
    assert sky(direct, wall, -outwards).mean() < 0.01
    assert sky(direct, wall, outwards).min() > 0.99


def test_an_open_sky_is_whole_and_a_wall_hides_half_of_it():
    floor = DirectLight(under_a_sky(SQUARE))
    assert sky(floor, torch.tensor([[0.3, 0.2, 0.0]]), UP).min() == 1
    wall = np.roll(SQUARE, 1, axis=-1) * np.float32((1, 2, 2)) + np.float32((0.2, 0, 0))
    beside = sky(DirectLight(under_a_sky(wall)), torch.tensor([[0.0, 0.0, 0.0]]), UP)
    assert beside.mean().item() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("is_lamp", [False, True])
@pytest.mark.parametrize(("transmission", "arrives"), [(0, 0), (1, 1)])
def test_what_shines_shades_other_light_unless_it_is_a_flame(is_lamp, transmission, arrives):
    scene = floor_scene()
    scene = replace(scene, seen=~(scene.is_light & is_lamp))
    plate = under_a_sky(SQUARE * 0.3 + np.float32((0, 0, 1)))
    plate.emission[:] = 1e-3
    plate.tiles[:, (TRANSMISSION, IOR)] = np.float32((transmission, 1.0))[:, None, None]
    shaded = DirectLight(scene.appended(plate))
    visible = shaded.visibility(torch.zeros(1, 3), UP).emitters[0, 0]
    assert visible.item() == pytest.approx(arrives, abs=0.05)


def test_a_plate_keeps_a_lamp_from_what_is_below_it():
    scene = floor_scene()  # its lamp stands two units above the middle
    plate = under_a_sky(SQUARE * 0.3 + np.float32((0, 0, 1)))
    shaded = DirectLight(scene.appended(plate))
    points = torch.tensor([[0.0, 0.0, 0.0], [0.9, 0.9, 0.0], [0.0, 0.0, 1.0]])
    visible = shaded.visibility(points, UP.expand(3, 3)).emitters[:, 0]
    torch.testing.assert_close(visible, torch.tensor([0.0, 1.0, 1.0]))


@pytest.mark.parametrize("is_lamp", [False, True])
def test_a_housing_that_is_close_to_a_lamp_shades_its_light(is_lamp):
    """But surfaces that shine are not exactly where their emitters are, which they must not shade."""
    scene = floor_scene()
    scene = replace(scene, seen=~(scene.is_light & is_lamp))
    plate = under_a_sky(SQUARE * 0.3 + np.float32((0, 0, 2 - 2e-3)))
    visible = DirectLight(scene.appended(plate)).visibility(torch.zeros(1, 3), UP).emitters[0, 0]
    assert visible.item() == (0 if is_lamp else 1)


def test_the_shadow_of_a_wide_lamp_has_a_soft_edge():
    """A lamp of half a unit's radius, two above the floor; a plate halfway whose edge is below its middle."""
    scene = floor_scene()
    lamp = scene.triangles[scene.is_light]
    scene.triangles[scene.is_light] = (lamp - lamp.mean(axis=(0, 1))) * 6 + np.float32((0, 0, 2))
    plate = under_a_sky(SQUARE + np.float32((1, 0, 1)))
    shaded, many = DirectLight(scene.appended(plate)), 400
    start, visible = r2_starts(torch.arange(many))[:, None], []
    for x in (-0.9, 0.0, 0.9):
        points = torch.tensor([[x, 0.1, 0.0]]).expand(many, 3)
        visible.append(shaded.emitter_visibility(points, UP.expand(many, 3), points[:, None], start)[0].mean().item())
    assert visible[0] > 0.95 and 0.25 < visible[1] < 0.75 and visible[2] < 0.05


def test_suns_are_parallel_and_one_emitter_however_many_triangles_they_have():
    sun = floor_scene(side=6).triangles[:-1] + np.float32((0, 0, 40))
    emitters = gather_emitters(replace(under_a_sky(sun), emission=np.ones((len(sun), 3), np.float32)))
    assert len(emitters) == 1 and len(emitters.radii) == 1


def test_a_highlight_has_the_shadow_of_its_own_lamp():
    """A lamp above a point of the floor, which mirrors it, and one aside; a plate hides the first or nothing."""
    floor = floor_scene()
    aside = replace(under_a_sky(floor.triangles[-1:] + np.float32((1.5, 0, -0.5))), emission=floor.emission[-1:])
    start = r2_starts(torch.arange(4))[None]
    for height, visible in (1, 0), (9, 1):
        plate = under_a_sky(SQUARE * 0.3 + np.float32((0, 0, height)))
        direct = DirectLight(floor.appended(aside, plate))
        gloss = torch.full((1,), 0.1), torch.full((1,), 0.04)
        point = torch.zeros(1, 3)
        diffuse, glossy, _ = direct.emitter_visibility(point, UP, point[None], start, UP, *gloss)
        torch.testing.assert_close(glossy, torch.full((1, 3), float(visible)), atol=0.02, rtol=0)
        assert 0.1 < diffuse.mean() < 0.9 or visible


def test_what_lies_close_above_a_floor_shades_it():
    card = SQUARE * 0.5 + np.float32((0, 0, 1e-3))
    direct = DirectLight(under_a_sky(np.concatenate([SQUARE, card])))
    assert sky(direct, torch.tensor([[0.0, 0.0, 0.0], [0.9, 0.9, 0.0]]), UP.expand(2, 3)).mean(1).tolist() == [0, 1]


@pytest.mark.parametrize("by_look", [False, True])
@pytest.mark.parametrize("panes", [1, 2])
def test_panes_that_bend_no_shadow_rays_dim_lamps_and_sky_by_their_colours(panes, by_look):
    tint = np.float32((0.9, 0.5, 0.1))
    scene = floor_scene()
    for height in np.linspace(0.5, 1, panes):
        pane = under_a_sky(SQUARE * 20 + np.float32((0, 0, height)))
        pane.tiles[:] = constant_tile(tint ** 2, transmission=1.0, roughness=0.0, ior=1.0)
        scene = scene.appended(pane)
    scene.environment = np.ones((32, 64, 3), np.float32)
    if by_look:  # glass to other rays
        scene.tiles = np.concatenate([scene.tiles, constant_tile((1, 1, 1), transmission=1.0, ior=1.5)[None]])
        is_pane = scene.tile_index > 0
        scene.hidden = np.where(is_pane, Ray.SHADOW, 0).astype(np.uint8)
        scene.shadow_tile = np.where(is_pane, scene.tile_index, -1).astype(np.int32)
        scene.tile_index[is_pane] = len(scene.tiles) - 1
    found = DirectLight(scene).visibility(torch.zeros(1, 3), UP, sky_rays=256)
    for visible in found.sky, found.emitters:
        np.testing.assert_allclose(visible[0], tint ** panes, atol=0.02)


def test_what_is_below_the_horizon_of_a_point_is_not_in_its_shadow():
    """Form factors leave it out already: a lamp sunk into a floor would be as dark again."""
    scene = floor_scene()
    scene.triangles[-1] = [(0.5, -0.1, -0.1), (0.5, 0, 0.2), (0.5, 0.1, -0.1)]
    points = torch.rand(100, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([0.4, 0.4, 0.0])
    assert DirectLight(scene).visibility(points, UP.expand(100, 3)).emitters.min() == 1


def test_a_round_body_does_not_light_itself():
    """An octahedron is a sphere in closed form, which is above the middle of its faces."""
    outwards = 0.1 * OCTAHEDRON
    body = replace(under_a_sky(outwards), emission=np.full((8, 3), 10, np.float32))
    scene = body.appended(under_a_sky(SQUARE - np.float32((0, 0, 0.2))))
    direct = DirectLight(scene)
    assert len(gather_emitters(scene).radii) == 1
    side = unit(area_vectors(outwards))
    assert direct.emitters.diffuse(torch.tensor(outwards.mean(1)), torch.tensor(side))[0].max() == 0
    assert direct.emitters.diffuse(torch.tensor([[0.0, 0.0, -0.2]]), UP)[0].min() > 0.5


@pytest.mark.parametrize("rays", [1, 2, 6])
def test_the_hidden_part_of_a_large_lamp_counts_by_its_light_and_not_by_its_area(rays):
    """A sheet hides the nearer half, from where most light comes."""
    lamp = grid(64, 32, 2.0, 1.0, 1.5) + np.float32((1.2, 0, 0))
    sheet = grid(1, 1, 1.2, 1.2, 1.4) + np.float32((0.6, 0, 0))
    whole = lit_by(grid(1, 1, 2.0, 1.0, 1.5) + np.float32((1.2, 0, 0)), 1.0)
    x = torch.tensor([[0.2, 0.0, 0.0]]).expand(512, 3)
    start = torch.rand(512, rays, 2, generator=torch.Generator().manual_seed(0))
    emitters = DirectLight(whole.appended(flat(sheet, (0.5, 0.5, 0.5)))).emitters
    visible = emitters.visibility(x, UP.expand(512, 3), x[:, None].expand(-1, rays, -1), start)[0].mean().item()
    is_seen = np.abs(lamp.mean(axis=1)[:, 0] - 0.2) * 1.4 / 1.5 > 1.0  # beyond the sheet's edge
    share = irradiance(lamp[is_seen], 1.0, x[0].numpy(), UP[0].numpy())[0] / irradiance(
        lamp, 1.0, x[0].numpy(), UP[0].numpy())[0]
    assert share < 0.7 * is_seen.mean() and visible == pytest.approx(share, rel=0.12)
