# SPDX-License-Identifier: GPL-3.0-or-later
"""Half-transparent sheets are first hits of their own colour, through which pixels show what lies behind."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.first_hits.sheets import own_texels, sheet_tiles, through_sheets
from renderformer_v2.model.light.specular.ends import add_path_ends
from renderformer_v2.model.scene import BASE_COLOR, PARAMETERS, TRANSMISSION, RenderScene, Volumes, constant_tile
from tests.model.samples import floor_scene, floor_view

SIZE = 32
YELLOW, FLOOR = np.float32((0.9, 0.8, 0.2)), np.float32((0.8, 0.5, 0.2))
CLEAR = 0.4
INSIDE, OUTSIDE, CORNER = (SIZE // 2, SIZE // 2 + 6), (SIZE // 2, 1), (0, 0)  # pixels; the last one shows no floor


def sheet_tile(color=YELLOW, clear=CLEAR) -> np.ndarray:
    """A matte material of this colour mixed with a colourless window, as the conversion does it."""
    share = color.mean() * (1 - clear)
    base = np.float32(color) * (1 - clear) + clear
    return constant_tile(base, transmission=clear / (share + clear), ior=1.0, roughness=1.0)


def sheet(x=(-0.5, 0.5), z=1.0, tile=None) -> RenderScene:
    corners = [np.float32((a, b, z)) for a, b in ((x[0], -2), (x[1], -2), (x[1], 2), (x[0], 2))]
    square = np.stack([np.stack([corners[i] for i in face]) for face in ((0, 1, 2), (0, 2, 3))])
    rows = np.zeros((2, 3), np.float32)
    return RenderScene(square, np.tile(np.float32((0, 0, 1)), (2, 3, 1)), rows, rows, rows[:, :2],
                       np.zeros(2, np.int32), (sheet_tile() if tile is None else tile)[None],
                       clear=np.full((1, 3), CLEAR, np.float32))


def behind_sheet(**settings) -> RenderScene:
    """A floor, its lamp, and a sheet above it."""
    return floor_scene().appended(sheet(**settings))


def seen(scene: RenderScene):
    view, _ = floor_view(SIZE, SIZE)
    guides = cast_guides(scene, view)
    return view, guides, through_sheets(guides, scene, view)


def test_pixels_show_the_sheet_and_what_passes_it():
    view, before, guides = seen(behind_sheet())
    assert guides.straight[INSIDE] and not guides.straight[OUTSIDE]
    np.testing.assert_allclose(guides.diffuse_color[INSIDE], YELLOW * (1 - CLEAR), atol=0.02)
    np.testing.assert_allclose(guides.transmission_color[INSIDE], CLEAR, atol=1e-3)
    assert guides.position[INSIDE][2] == pytest.approx(1, abs=1e-4)
    np.testing.assert_allclose(guides.material[INSIDE][BASE_COLOR], YELLOW, atol=0.02)
    assert guides.material[INSIDE][TRANSMISSION] == 0
    for name in ("diffuse_color", "transmission_color", "position", "normal"):
        np.testing.assert_array_equal(getattr(guides, name)[~guides.straight], getattr(before, name)[~guides.straight])


def test_its_border_is_mixed_with_what_lies_beside_it():
    _, _, guides = seen(behind_sheet(x=(-0.5, 0.53)))
    row = guides.transmission_color[SIZE // 2, :, 0] * guides.straight[SIZE // 2]
    assert ((row > 0.05 * CLEAR) & (row < 0.95 * CLEAR)).any() and row.max() == pytest.approx(CLEAR, abs=1e-3)


def test_paths_go_straight_to_the_floor_and_know_its_colour():
    view, _, guides = seen(behind_sheet())
    ends = add_path_ends(guides, behind_sheet(), view)
    assert ends.refracted_position[INSIDE][2] == pytest.approx(0, abs=1e-3)
    np.testing.assert_allclose(ends.refracted_color[INSIDE].astype(np.float32), FLOOR, rtol=0.04)  # below a layer
    assert not ends.refracted_light.any()


def test_the_sky_behind_a_sheet_has_its_share_whatever_samples_found():
    scene = behind_sheet(x=(-3, 3))
    scene.environment = np.ones((8, 16, 3), np.float32)
    view, _ = floor_view(SIZE, SIZE)
    guides = cast_guides(scene, view)
    chance = np.random.default_rng(1).uniform(0.3, 0.6, guides.alpha.shape).astype(np.float32)
    guides = replace(guides, alpha=1 - chance, environment=np.repeat(2 * chance[..., None], 3, -1))
    after = through_sheets(guides, scene, view)
    assert after.straight[CORNER]
    assert after.alpha[CORNER] == pytest.approx(1 - CLEAR, abs=1e-3)
    np.testing.assert_allclose(after.environment[CORNER], 2 * CLEAR, rtol=1e-3)
    assert after.alpha[INSIDE] == guides.alpha[INSIDE]
    assert not add_path_ends(after, scene, view).refracted_light.any()  # the environment shows it already


def test_a_second_sheet_before_the_sky_is_seen_by_its_share_and_not_by_chance():
    scene = sheet().appended(sheet(z=0.9))
    scene.environment = np.ones((8, 16, 3), np.float32)
    view, _, guides = seen(scene)
    ends = add_path_ends(guides, scene, view)
    around = np.s_[INSIDE[0] - 2:INSIDE[0] + 3, INSIDE[1] - 3:INSIDE[1] + 2]
    assert guides.straight[around].all()
    colors = ends.refracted_color[around].astype(np.float32)
    np.testing.assert_allclose(colors, np.broadcast_to((1 - CLEAR) * YELLOW, colors.shape), rtol=0.05)


def test_cut_out_shapes_and_fog_change_nothing():
    cut_out = sheet_tile()
    cut_out[TRANSMISSION, :16] = 0
    assert not sheet_tiles(behind_sheet(tile=cut_out)).any()
    scene, one = behind_sheet(), np.ones((1, 3), np.float32)
    scene.volumes = Volumes(np.ones((1, 64), np.float32), 0 * one, 0 * one, one, one, one)
    view, _ = floor_view(SIZE, SIZE)
    guides = cast_guides(scene, view)
    assert through_sheets(guides, scene, view) is guides


@pytest.mark.parametrize("clear", [0.1, 0.5, 0.9])
def test_a_sheet_alone_is_what_was_mixed_with_a_window(clear):
    tile = sheet_tile(clear=clear).astype(np.float32)
    texel = own_texels(tile[None, :, 0, 0], np.full((1, 3), clear, np.float32))[0, PARAMETERS]
    np.testing.assert_allclose(texel[BASE_COLOR], YELLOW, atol=0.03)
    assert texel[TRANSMISSION] == 0


@pytest.mark.parametrize("count, is_straight", [(4, True), (5, False)])
def test_many_sheets_are_left_to_the_means_of_samples(count, is_straight):
    _, _, guides = seen(floor_scene().appended(*(sheet(z=1 + 0.1 * i) for i in range(count))))
    assert (guides.straight is not None and bool(guides.straight[INSIDE])) == is_straight


def test_nearly_clear_sheets_hide_nothing_from_single_paths():
    """Each pixel has one path: those that ended at such a sheet would be speckles."""
    lower = replace(sheet(z=0.5, tile=sheet_tile(clear=0.8)), clear=np.full((1, 3), 0.8, np.float32))
    view, _, guides = seen(behind_sheet())
    shows_floor = guides.straight & add_path_ends(guides, behind_sheet(), view).refracted_color.any(-1)
    scene = behind_sheet().appended(lower)
    _, _, guides = seen(scene)
    ends = add_path_ends(guides, scene, view)
    assert shows_floor.sum() > 50
    np.testing.assert_allclose(ends.refracted_position[shows_floor][:, 2], 0, atol=1e-3)
