# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that see several surfaces show the light of each, by how much of it they see and by its colour."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.first_hits import camera_rays
from renderformer_v2.model.first_hits.camera_rays import SAMPLE_POINTS, CameraRays, cast_guides
from renderformer_v2.model.geometry import area_vectors, unit
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.edges import _kink, find_edges
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.scene import constant_tile
from tests.model.samples import flat, floor_scene, floor_view

SIZE, CPU = 32, torch.device("cpu")
EDGE = SIZE // 2  # column in which the plate ends
FLOOR, PLATE = 3.0, 1.0  # their light


def floor_and_plate(color=(0.5, 0.5, 0.5)):
    """A grey floor and a plate of this colour above its left half, that reaches 0.3 pixels into a column."""
    floor, (view, _) = floor_scene().triangles[:-1], floor_view(SIZE, SIZE)
    end = 0.3 * 2 / SIZE  # two units from the camera
    plate = (floor * np.float32((1 + end, 2, 1)) / 2 + np.float32((end / 2 - 0.5, 0, 1))).astype(np.float32)
    scene = flat(floor * np.float32((2, 2, 1)), (0.5, 0.5, 0.5)).appended(flat(plate, color))
    scene.normals[:] = 0, 0, 1
    guides = cast_guides(scene, view)
    light = torch.where(torch.from_numpy(guides.position[..., 2] > 0.5), PLATE, FLOOR).expand(3, -1, -1).clone()
    return scene, view, guides, light


def test_light_is_mixed_by_how_much_a_pixel_sees_of_each_surface():
    scene, view, guides, light = floor_and_plate()
    before = light.clone()
    find_edges(scene, view, guides, CPU).mix(light, 0)
    inside, covered = slice(4, -4), (SAMPLE_POINTS[:, 0] < 0.3).mean()
    expected = covered * PLATE + (1 - covered) * FLOOR
    assert light[0, inside, EDGE].numpy() == pytest.approx(expected, abs=0.15)
    assert torch.equal(light[:, inside, :EDGE - 1], before[:, inside, :EDGE - 1])
    assert torch.equal(light[:, inside, EDGE + 2:], before[:, inside, EDGE + 2:])
    assert (light[0, inside, EDGE - 1] >= PLATE).all() and light[0, inside, EDGE - 1].mean() < 1.5


def test_light_of_a_black_surface_counts_for_nothing():
    scene, view, guides, light = floor_and_plate((0, 0, 0))
    find_edges(scene, view, guides, CPU).mix(light, 0)
    assert light[0, 4:-4, EDGE].numpy() == pytest.approx(FLOOR, abs=0.05)


def test_a_sliver_that_no_ray_finds_shows_the_light_of_what_is_around_in_its_colour(monkeypatch):
    scene, view, guides, light = floor_and_plate((0, 0, 0))
    middle = camera_rays.SAMPLE_POINTS * 0 + np.float32((0.01, 0.5))
    monkeypatch.setattr(camera_rays, "SAMPLE_POINTS", middle)  # on the plate, of which the pixels have the middle
    find_edges(scene, view, guides, CPU).mix(light, 0)
    assert light[0, 4:-4, EDGE - 1].numpy() == pytest.approx(FLOOR, abs=0.05)


def ridges(count: int, height: float) -> np.ndarray:
    """A sheet of the square [-1, 1]^2, folded lengthwise into strips that rise and fall by turns."""
    x = np.linspace(-1, 1, count + 1)
    z = np.arange(count + 1) % 2 * height
    low, high = (np.stack([x, np.full_like(x, y), z], -1) for y in (-1, 1))
    return np.concatenate([np.stack([low[:-1], low[1:], high[1:]], 1), np.stack([low[:-1], high[1:], high[:-1]], 1)])


@pytest.mark.parametrize("degrees, has_edges", [(6, False), (20, True)])
def test_facets_have_edges_even_where_they_hardly_turn(degrees, has_edges):
    """Edge weights alone take 20 degrees for one surface."""
    count = 4
    height = np.tan(np.radians(degrees / 2)) * 2 / count
    scene, (view, _) = flat(ridges(count, height).astype(np.float32), (0.5, 0.5, 0.5)), floor_view(SIZE, SIZE)
    scene.normals[:] = unit(area_vectors(scene.triangles))[:, None]
    edges = find_edges(scene, view, cast_guides(scene, view), CPU)
    assert (len(edges.pixel) > (count - 1) * SIZE / 2) == has_edges
    assert has_edges or not len(edges.pixel)


def test_a_round_surface_has_no_edges_however_strongly_it_is_bent():
    x, y = np.meshgrid(*[np.linspace(-1, 1, 12)] * 2)
    x, y, z = np.broadcast_arrays(x, y, np.sqrt((1 - x ** 2 - y ** 2).clip(0)))
    normal = torch.from_numpy(np.stack([x, y, z]).astype(np.float32))
    bent = (normal[:, :, 1:] - normal[:, :, :-1]).norm(dim=0)[4:8, 3:8]
    assert (bent > 0.15).all() and (_kink(normal, 0, 1)[4:8, 3:8] < 0.05).all()


def test_one_surface_has_no_edges():
    scene, view, _, light = floor_and_plate()
    floor = replace(scene, seen=scene.triangles[:, :, 2].max(1) < 0.5)
    edges = find_edges(floor, view, cast_guides(floor, view), CPU)
    assert len(edges.pixel) == 0
    edges.mix(light, 0)  # nothing to do is no error


def test_bumps_of_a_material_have_no_edges():
    """Light that falls on a groove is its own, not that of the flat surface around, which rays would find."""
    scene, (view, guides) = floor_scene(), floor_view()
    guides.normal[:, 30:32] = unit(np.float32((1, 0, 1)))
    edges = find_edges(scene, view, guides, CPU)
    assert not ((edges.pixel % view.width >= 20) & (edges.pixel % view.width < 42)).any()


def test_where_the_tokens_are_not_what_is_seen_light_stays():
    scene, view, guides, light = floor_and_plate()
    before, moved = light.clone(), replace(scene, triangles=scene.triangles - np.float32((0, 0, 0.3)))
    find_edges(moved, view, guides, CPU).mix(light, 0)
    assert torch.equal(light, before)


def test_edges_of_a_large_picture_are_found_in_bands(monkeypatch):
    scene, view, guides, _ = floor_and_plate()
    whole = find_edges(scene, view, guides, CPU)
    monkeypatch.setattr("renderformer_v2.model.light.edges.BAND_PIXELS", 5 * SIZE)
    parts = find_edges(scene, view, guides, CPU)
    assert len(whole.pixel) > SIZE and torch.equal(whole.pixel, parts.pixel)
    assert torch.equal(whole.neighbours, parts.neighbours)
    torch.testing.assert_close(whole.share, parts.share)


def test_each_facet_in_a_pixel_mirrors_lamps_of_its_own():
    """Against the light at all samples of each pixel."""
    count = 4
    sheet = ridges(count, np.tan(np.radians(7)) * 2 / count).astype(np.float32)
    lamp = np.float32([[(-0.3, -0.3, 2.5), (0.3, 0.5, 2.5), (0.5, -0.3, 2.5)]])
    shining = replace(flat(lamp, (0, 0, 0)), emission=np.full((1, 3), 50, np.float32))
    scene = flat(sheet, (0.5, 0.5, 0.5)).appended(shining)
    scene.seen = np.arange(len(scene)) < len(scene) - 1
    scene.tiles[:] = constant_tile((0.9, 0.9, 0.9), metallic=1.0, roughness=0.25)[None]
    scene.normals[:] = unit(area_vectors(scene.triangles))[:, None]
    view, _ = floor_view(SIZE, SIZE)
    guides, direct = cast_guides(scene, view), DirectLight(scene)

    def glossy(position, normal):
        x, n = (torch.from_numpy(values.reshape(-1, 3)) for values in (position, normal))
        v = torch.nn.functional.normalize(torch.from_numpy(view.camera_to_world[:3, 3]) - x, dim=-1)
        return direct.lobes(x, n, v, torch.full((len(x),), 0.25), torch.ones(len(x)))[1]

    light = glossy(guides.position, guides.normal).T.reshape(3, SIZE, SIZE)
    edges = find_edges(scene, view, guides, CPU, direct)
    samples = CameraRays(scene, view).sample(edges.pixel.numpy())
    exact = glossy(samples.position, samples.normal).view(len(edges.pixel), -1, 3).mean(1).T
    errors = []
    for is_direct in (False, True):
        mixed = light.clone()
        edges.mix(mixed, LOBES.index("glossy"), is_direct)
        errors.append(float((mixed.view(3, -1)[:, edges.pixel] - exact).abs().mean() / exact.mean()))
    assert len(edges.pixel) > SIZE and errors[1] < min(0.1, errors[0] / 2), errors
