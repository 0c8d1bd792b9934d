# SPDX-License-Identifier: GPL-3.0-or-later
"""Few emitters in place of many light triangles, whatever the scene, and with as much light."""
from itertools import product

import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import area_vectors
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.emitters import MAX_EMITTERS, gather_emitters
from renderformer_v2.model.light.direct.outlines import cut, outline_vectors
from renderformer_v2.model.light.direct.pictures import CELLS
from renderformer_v2.model.scene import EMISSION_SIZE, RenderScene, barycentric_grid, constant_tile

FLOOR = np.float32([[(-2, -2, 0), (2, -2, 0), (2, 2, 0)], [(-2, -2, 0), (2, 2, 0), (-2, 2, 0)]])
UP = np.array([0, 0, 1.0])


def lit_by(corners, radiance, axis=None, cosine=None) -> RenderScene:
    """A dark floor 4 units wide under light triangles."""
    n, count = len(corners), len(corners) + 2
    rows = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32), np.zeros((count, 2), np.float32)
    for row, values in zip(rows, (radiance, axis, cosine), strict=True):
        if values is not None:
            row[:n] = values
    return RenderScene(np.concatenate([np.float32(corners), FLOOR]), np.zeros((count, 3, 3), np.float32), *rows,
                       np.zeros(count, np.int32), constant_tile()[None])


def grid(columns, rows, width, depth, height) -> np.ndarray:
    """(2 * columns * rows, 3, 3) triangles of a rectangle above the origin, facing down."""
    x, y = np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-depth / 2, depth / 2, rows + 1)
    triangles = []
    for i, j in product(range(columns), range(rows)):
        a, b, c, d = ((x[i + s], y[j + t], height) for s, t in ((0, 0), (0, 1), (1, 1), (1, 0)))
        triangles += [(a, b, c), (a, c, d)]
    return np.float32(triangles)


def ball(center, radius, segments, rings) -> np.ndarray:
    """(n, 3, 3) triangles of a sphere, facing outwards."""
    theta, phi = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, segments + 1)
    point = lambda t, p: np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])  # noqa: E731
    triangles = []
    for i, j in product(range(rings), range(segments)):
        a, b = point(theta[i], phi[j]), point(theta[i + 1], phi[j])
        c, d = point(theta[i + 1], phi[j + 1]), point(theta[i], phi[j + 1])
        triangles += [(a, b, c)] * (i < rings - 1) + [(a, c, d)] * (i > 0)
    return np.float32(center) + radius * np.float32(triangles)


def box(size, center) -> np.ndarray:
    """(12, 3, 3) triangles of a box, facing outwards."""
    triangles = []
    for axis, sign in product(range(3), (-1, 1)):
        n, u, v = np.roll(np.eye(3), -axis, axis=0)
        a, b, c, d = (sign * n + s * sign * u + t * v for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        triangles += [(a, b, c), (a, c, d)]
    return np.float32(np.array(triangles) * np.array(size) / 2 + center)


def swept(points, radius, sides=12) -> np.ndarray:
    """(n, 3, 3) triangles of an open tube of a radius around points (K, 3) or of radii (K,), facing outwards."""
    points, radius = np.asarray(points, float), np.broadcast_to(radius, len(points))
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    first = np.cross(along, np.eye(3)[np.abs(along).max(axis=0).argmin()])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second, turn = np.cross(along, first), 2 * np.pi * np.arange(sides + 1)[:, None, None] / sides
    rings = points + radius[:, None] * (np.cos(turn) * first + np.sin(turn) * second)
    triangles = []
    for i, j in product(range(sides), range(len(points) - 1)):
        a, b, c, d = rings[i, j], rings[i + 1, j], rings[i + 1, j + 1], rings[i, j + 1]
        triangles += [(a, b, c), (a, c, d)]
    return np.float32(triangles)


def irradiance(corners, radiance, x, n) -> np.ndarray:
    """(3,) from the front of small triangles."""
    vectors, to = area_vectors(corners.astype(np.float64)), corners.mean(axis=1) - x
    distance = np.linalg.norm(to, axis=1)
    emitted = np.maximum(-(to * vectors).sum(axis=1), 0) * np.maximum(to @ n, 0) / distance ** 4
    return emitted @ np.broadcast_to(radiance, (len(corners), 3))


def diffuse(scene, x, n=UP) -> np.ndarray:
    t = lambda a: torch.tensor(np.float32(a))[None]  # noqa: E731
    return np.pi * DirectLight(scene).lobes(t(x), t(n), t(n), *torch.tensor([[0.5], [0.04]]))[0][0].double().numpy()


def test_emission_texture_becomes_few_emitters_of_the_same_light():
    corners = grid(24, 20, 1.2, 1.0, 1.5)
    radiance = np.random.default_rng(0).uniform(0, 5, (len(corners), 3)) * (corners.mean(axis=1) > 0)[:, :1] + 0.1
    scene = lit_by(corners, radiance)
    emitters = gather_emitters(scene)
    assert len(emitters) == CELLS
    area = np.linalg.norm(outline_vectors(emitters.corners), axis=1)
    np.testing.assert_allclose(area.sum(), 1.2, rtol=1e-4)  # they have no gaps
    exact = np.linalg.norm(area_vectors(corners), axis=1) @ radiance
    np.testing.assert_allclose(area @ emitters.radiance, exact, rtol=1e-4)
    for x in ((0, 0, 0), (1, 0.5, 0), (-0.4, 0.3, 1.0)):
        np.testing.assert_allclose(diffuse(scene, np.array(x)), irradiance(corners, radiance, x, UP), rtol=0.05)


SCREEN = np.float32([[(-1, -1, 1), (-1, 1, 1), (1, 1, 1)], [(-1, -1, 1), (1, 1, 1), (1, -1, 1)]])  # facing down


def screen(*others) -> RenderScene:
    """A square that is red where x is below 0 and has green where it is above 0.5; and other triangles that shine."""
    scene = lit_by(np.concatenate([SCREEN, *others]), 1.0)
    grid = barycentric_grid(EMISSION_SIZE)
    scene.emission_tile, scene.emission_tiles = np.full(len(scene), -1, np.int32), np.zeros(
        (2, 3, EMISSION_SIZE, EMISSION_SIZE), np.float16)
    for i, corners in enumerate(SCREEN):
        x = (grid @ corners)[..., 0]
        scene.emission_tile[i] = i
        scene.emission_tiles[i] = np.stack([x < 0, x > 0.5, 0 * x])
    return scene


def test_a_screen_lights_by_place_and_with_all_of_its_light():
    emitters = gather_emitters(screen())
    area = np.linalg.norm(outline_vectors(emitters.corners), axis=1)
    assert len(emitters) == CELLS
    np.testing.assert_allclose(area @ emitters.radiance, (2, 1, 0), rtol=0.03)
    fine = grid(40, 40, 2, 2, 1)
    x = fine.mean(axis=1)[:, 0]
    radiance = np.stack([x < 0, x > 0.5, 0 * x], axis=1)
    for place in ((-0.9, 0, 0.5), (0, 0, 0), (0.9, 0.3, 0.5)):
        np.testing.assert_allclose(diffuse(screen(), np.array(place)), irradiance(fine, radiance, place, UP), rtol=0.05,
                                   atol=0.02)


def test_faces_of_a_box_are_pictures_of_their_own():
    scene = lit_by(box((1, 1, 1), (0, 0, 1)), 1.0)
    scene.emission_tile = np.int32([0] * 12 + [-1, -1])
    scene.emission_tiles = np.ones((1, 3, EMISSION_SIZE, EMISSION_SIZE), np.float16)
    scene.emission_tiles[:, 0, ::2] = 0
    emitters, per_face = gather_emitters(scene), CELLS // 6
    assert len(emitters) == 6 * per_face and len(emitters.pictures) == 6
    vectors = outline_vectors(emitters.corners).reshape(6, per_face, 3)
    np.testing.assert_allclose(np.linalg.norm(vectors.sum(axis=1), axis=1), 1, rtol=1e-4)


@pytest.mark.parametrize("height", [1e-5, 0, -1e-5])
def test_a_screen_does_not_light_itself(height):
    for x in ((0.3, 0.2, 1 - height), (-0.7, 0.77, 1 - height)):
        np.testing.assert_allclose(diffuse(screen(), np.array(x), -UP), 0, atol=1e-3)


def test_lamps_beside_a_screen_stay_as_they_are():
    lamp = ball((0, 0, 0.5), 0.1, 16, 8)
    emitters, alone = gather_emitters(screen(lamp)), gather_emitters(lit_by(lamp, 1.0))
    assert len(emitters.corners) == CELLS and len(emitters.radii) == len(alone.radii) == 1
    np.testing.assert_allclose(emitters.radii, alone.radii)
    np.testing.assert_allclose(emitters.radiance[-1], 1)


@pytest.mark.parametrize(("roughness", "sharpness"), [(0.0, 0.04), (0.1, 0.1), (0.3, 0.5)])
def test_gloss_shows_the_picture_on_a_screen_and_blurs_it(roughness, sharpness):
    light, x = DirectLight(screen()), np.linspace(-0.8, 0.8, 81)
    points = torch.tensor(np.float32(np.stack([x, 0 * x, 0 * x], axis=1)))
    up = torch.tensor([[0.0, 0, 1]]).expand_as(points)
    glossy = light.lobes(points, up, up, torch.full((81,), roughness), torch.ones(81))[1].numpy()
    far = np.abs(x) > sharpness
    np.testing.assert_allclose(glossy[far, 0], x[far] < 0, atol=0.15)
    far = np.abs(x - 0.5) > sharpness
    np.testing.assert_allclose(glossy[far & (x < 0.7), 1], x[far & (x < 0.7)] > 0.5, atol=0.15)
    assert (np.diff(glossy[:, 0]) < 0.02).all()


def test_few_emitters_stay_as_they_are():
    corners = grid(8, MAX_EMITTERS // 16, 1, 1, 1)
    radiance = np.random.default_rng(0).uniform(1, 2, (len(corners), 3))
    emitters = gather_emitters(lit_by(corners, radiance))
    assert len(emitters) == len(corners) == MAX_EMITTERS
    assert {frozenset(map(tuple, c)) for c in emitters.corners} == {frozenset(map(tuple, c)) for c in corners}


def test_textured_ball_shines_like_a_ball_and_a_textured_dome_from_inside():
    rng = np.random.default_rng(0)
    corners = ball((0, 0, 2), 0.3, 32, 16)
    radiance = rng.uniform(1, 2, (len(corners), 3))
    scene = lit_by(corners, radiance)
    np.testing.assert_allclose(diffuse(scene, np.zeros(3)), irradiance(corners, radiance, (0, 0, 0), UP), rtol=0.05)
    dome = ball((0, 0, 0), 4.0, 32, 16)
    radiance = 1 + (dome.mean(axis=1)[:, 2:] > 0) * rng.uniform(1, 2, (len(dome), 3))
    expected = irradiance(dome[:, ::-1], radiance, (0, 0, 0), UP)
    np.testing.assert_allclose(diffuse(lit_by(dome, radiance), np.zeros(3)), expected, rtol=0.1)


def test_many_lamps_become_few_that_keep_place_colour_and_beam():
    balls, radiance, axis = [], [], []
    for i, j in product(range(15), range(15)):
        balls.append(ball((i / 4 - 1.75, j / 4 - 1.75, 1), 0.01, 4, 2))
        radiance += [(1, 0, 0) if i < 7 else (0, 0, 1)] * len(balls[-1])
        axis += [(0, 0, -1) if i < 7 else (0, 0, 1)] * len(balls[-1])
    corners, radiance = np.concatenate(balls), 1e3 * np.array(radiance)
    scene = lit_by(corners, radiance, axis, (0.5, 0.6))
    emitters = gather_emitters(scene)
    assert len(emitters) == len(emitters.radii) == MAX_EMITTERS
    exact = np.linalg.norm(area_vectors(corners), axis=1) @ radiance
    np.testing.assert_allclose(4 * np.pi * emitters.radii ** 2 @ emitters.radiance, exact, rtol=1e-4)
    light = diffuse(scene, np.array((-1.0, 0, 0)))
    assert light[0] > 0 and light[2] == 0  # the blue ones point up


@pytest.mark.parametrize("x", [(0, 0, 0), (2.0, 1.0, 0), (0, 0, 1.0)])
def test_a_dome_around_everything_lights_evenly(x):
    dome = ball((0.3, 0, 0.2), 4.0, 32, 16)
    np.testing.assert_allclose(diffuse(lit_by(dome, (1.0, 2.0, 3.0)), np.array(x)), np.pi * np.arange(1, 4), rtol=0.06)


def test_a_ring_does_not_shine_from_its_middle():
    turn = 2 * np.pi * np.arange(49)[:, None] / 48
    corners = swept(np.concatenate([np.cos(turn), np.sin(turn), 1 + 0 * turn], 1), 0.06)
    scene = lit_by(corners, (1.0, 2.0, 3.0))
    for x in ((0, 0, 0), (0, 0, 0.9), (1.0, 0, 0.4), (1.5, 0.5, 0)):
        np.testing.assert_allclose(diffuse(scene, np.array(x)), irradiance(corners, (1.0, 2.0, 3.0), x, UP), rtol=0.1)


def test_a_tube_lights_evenly_along_its_length():
    corners = swept(np.linspace((-2, 0, 0.3), (2, 0, 0.3), 41), 0.03)
    scene = lit_by(corners, (1.0, 1.0, 1.0))
    assert len(gather_emitters(scene)) == 3
    for x in ((0, 0, 0), (0.2, 0, 0), (0.5, 0.3, 0), (1.9, 0.1, 0)):
        np.testing.assert_allclose(diffuse(scene, np.array(x)), irradiance(corners, 1.0, x, UP), rtol=0.12)


def test_a_lampshade_hides_its_inside_from_those_outside():
    corners = swept([(0, 0, 0.8), (0, 0, 1.1), (0, 0, 1.4)], (0.6, 0.45, 0.3), 32)
    direct = DirectLight(lit_by(corners, (1.0, 1.0, 1.0)))
    x, n = torch.tensor([[2.0, 0.0, 1.1]]), torch.tensor([[-1.0, 0.0, 0.0]])
    x, n = x.expand(1024, 3), n.expand(1024, 3)
    start = torch.rand(1024, 2, generator=torch.Generator().manual_seed(0))
    light = np.pi * direct.diffuse(x, n, direct.visibility(x, n, start)).numpy()
    np.testing.assert_allclose(light.mean(0), irradiance(corners, 1.0, x[0].numpy(), n[0].numpy()), rtol=0.12)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_flat_panel_lights_what_it_faces(turn):
    corners = box((2, 2, 0.05), (0, 0, 0))
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    fine = grid(40, 40, 2, 2, -0.025) @ rotation.T + (0, 0, 2)
    scene = lit_by(corners @ rotation.T + (0, 0, 2), (3.0, 2.0, 1.0))
    expected = irradiance(fine, (3.0, 2.0, 1.0), (0, 0, 0), UP)
    np.testing.assert_allclose(diffuse(scene, np.zeros(3)), expected, rtol=0.07)
    np.testing.assert_allclose(diffuse(scene, np.array((0, 0, 4.0)), -UP), expected, rtol=0.07)


@pytest.mark.parametrize("degrees", [0.5, 30, 90, 150])
def test_a_sun_of_any_size_gives_the_light_of_its_disk(degrees):
    half, distance, turn = np.radians(degrees) / 2, 100.0, 2 * np.pi * np.arange(65) / 64
    rim = distance * np.tan(half) * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1) + distance * UP
    disk = np.stack([np.broadcast_to(distance * UP, (64, 3)), rim[1:], rim[:-1]], axis=1)
    sun = gather_emitters(lit_by(disk, (1.0, 1.0, 1.0)))
    assert len(sun.radii) == 1 and len(sun.corners) == 0
    assert sun.radii[0] / np.linalg.norm(sun.centers[0]) == pytest.approx(np.sin(half), rel=0.01)


def test_a_lamp_far_away_is_as_large_as_nearby():
    near, far = (gather_emitters(lit_by(ball((0, 0, height), 1, 16, 8), (1.0, 1.0, 1.0))) for height in (3, 60))
    assert far.radii == pytest.approx(near.radii, rel=1e-3) and near.radii[0] > 0.9


@pytest.mark.parametrize("corners", [[(0, 0, 1), (4, 0, 1), (4, 0.2, 1), (0, 0.2, 1)],
                                     [(np.cos(a), np.sin(a), 0) for a in np.arange(12) * np.pi / 6]])
def test_pieces_of_an_outline_have_its_area_and_no_long_sides(corners):
    whole = np.float32(corners)
    pieces = cut(whole, 16)
    areas = [np.linalg.norm(outline_vectors(piece.astype(np.float64))) for piece in pieces]
    assert len(pieces) == 16 and sum(areas) == pytest.approx(np.linalg.norm(outline_vectors(whole.astype(np.float64))))
    assert max(np.ptp(piece, axis=0).max() for piece in pieces) < 0.3 * np.ptp(whole, axis=0).max()


@pytest.mark.parametrize("degrees, count", [(20, 16), (120, 4), (150, 1)])
def test_a_flat_lamp_with_a_narrow_beam_lights_what_is_before_each_part(degrees, count):
    cosine = np.cos(np.radians(degrees / 2)), 1.0
    emitters = gather_emitters(lit_by(grid(2, 2, 1, 1, 2), 5.0, -UP, cosine))
    assert len(emitters) == count
