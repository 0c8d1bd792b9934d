# SPDX-License-Identifier: GPL-3.0-or-later
"""The closed forms of direct light against brute-force integration."""
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.environment import direction_map
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.emitter_light import EMITTER
from renderformer_v2.model.light.direct.emitters import gather_emitters
from renderformer_v2.model.light.direct.environment_light import EnvironmentLight, solid_angles
from renderformer_v2.model.light.direct.form_factors import beam, sphere_form_factor
from renderformer_v2.model.scene import RenderScene, constant_tile
from tests.model.samples import floor_scene

OCTAHEDRON = np.array([[(1, 0, 0), (0, s, 0), (0, 0, t)][:: s * t] for s in (1, -1) for t in (1, -1)]
                      + [[(-1, 0, 0), (0, s, 0), (0, 0, t)][:: -s * t] for s in (1, -1) for t in (1, -1)], np.float32)


def lit_by(corners, radiance=(1.0, 1.0, 1.0), axis=(0, 0, 0), cosine=(0, 0), environment=None) -> RenderScene:
    n = len(corners)
    rows = lambda x: np.tile(np.float32(x), (n, 1))  # noqa: E731
    return RenderScene(np.float32(corners), np.zeros((n, 3, 3), np.float32), rows(radiance), rows(axis), rows(cosine),
                       np.zeros(n, np.int32), constant_tile()[None], environment)


def integrated_irradiance(corners, x, n, samples=400):
    """Sum of cos cos dA / d^2 over fine pieces of the triangles."""
    u, v = np.meshgrid(*[(np.arange(samples) + 0.5) / samples] * 2)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    total = 0.0
    for a, b, c in np.float64(corners):
        points = a + u[..., None] * (b - a) + v[..., None] * (c - a)
        area_vector = np.cross(b - a, c - a) / 2
        to = points - x
        d2 = (to**2).sum(-1)
        direction = to / np.sqrt(d2)[..., None]
        total += ((direction @ n).clip(0) * np.abs(direction @ area_vector) / d2).mean()
    return total


def diffuse(scene, x, n):
    t = lambda a: torch.tensor(np.float32(a))[None]  # noqa: E731
    return DirectLight(scene).lobes(t(x), t(n), t(n), *torch.tensor([[0.5], [0.04]]))[0][0].numpy()


@pytest.mark.parametrize("cosine, sine2", [(0.9, 0.1), (0.2, 0.3), (-0.2, 0.3), (0.0, 0.5), (-0.5, 0.9)])
def test_sphere_form_factor_matches_monte_carlo(cosine, sine2):
    rng = np.random.default_rng(0)
    w = rng.standard_normal((1_000_000, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    inside = w @ [math.sqrt(1 - cosine**2), 0, cosine] > math.sqrt(1 - sine2)
    expected = 4 * (w[:, 2].clip(0) * inside).mean()
    assert sphere_form_factor(torch.tensor([cosine]), torch.tensor([sine2])).item() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("x, n", [((0, 0, 0), (0, 0, 1)), ((0.5, -0.3, 0.2), (0.6, 0, 0.8)), ((1, 0, 0), (0, 0, 1)),
                                  ((0, 0, 0.8), (0, 0.8, 0.6)), ((0, -0.3, 0.7), (1, 0, 0)), ((1, 0, 1), (0, 0, 1))])
def test_triangle_irradiance_matches_integration(x, n):
    """Also of what the horizon leaves of one close by."""
    corners = np.array([[(-0.3, -0.3, 1), (0.4, -0.2, 1.2), (0, 0.5, 0.9)]])
    expected = integrated_irradiance(corners, np.float64(x), np.float64(n)) / math.pi
    assert diffuse(lit_by(corners), x, n)[0] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x, n", [((0.12, 0, 0.1), (0, 0, 1)), ((0.3, 0.2, -0.05), (0, 0, 1)),
                                  ((0, 0, 1), (0, 0.6, -0.8)), ((0.1, 0.02, 0), (1, 0, 0))])
def test_a_box_shines_by_each_of_its_faces(x, n):
    """What is close to it is lit by those that it is before, and a face by none."""
    box = np.float32([(x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.3)])
    sides = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
    corners = box[[(a, b, c) for a, b, c, _ in sides] + [(a, c, d) for a, _, c, d in sides]]
    floor = np.float32([[(-1, -1, -1), (1, -1, -1), (0, 1, -1)]])
    scene = lit_by(np.concatenate([corners, floor]))
    scene.emission[12:] = 0
    assert gather_emitters(scene).corners.shape == (6, 4, 3)
    seen = corners[[np.cross(b - a, c - a) @ (x - a) > 1e-6 for a, b, c in np.float64(corners)]]
    expected = integrated_irradiance(seen, np.float64(x), np.float64(n)) / math.pi
    assert diffuse(scene, x, n)[0] == pytest.approx(expected, rel=0.02, abs=1e-4)


def test_closed_polyhedron_shines_like_a_sphere_of_equal_area():
    corners = OCTAHEDRON * 0.05 + np.float32((0, 0, 1))
    emitters = gather_emitters(lit_by(corners))
    assert len(emitters.corners) == 0 and len(emitters.radii) == 1
    area = 8 * math.sqrt(3) / 4 * (math.sqrt(2) * 0.05) ** 2
    assert diffuse(lit_by(corners), (0, 0, 0), (0, 0, 1))[0] == pytest.approx(area / 4 / math.pi, rel=0.01)


@pytest.mark.parametrize("height", [0.1, 0.4, 2.0])
def test_a_lamp_of_soft_falloff_shines_as_a_disk_that_faces_each_place(height):
    """Also on what is within its radius."""
    scene = lit_by(OCTAHEDRON * 0.3 + [0, 0, height], radiance=(0.5, 0.5, 0.5))
    soft = replace(scene, softened=np.full(len(scene), 0.5, np.float32))
    radius2 = 0.3 ** 2 * math.sqrt(3) / math.pi  # of the sphere of its area
    share = radius2 / (radius2 + height ** 2)
    assert diffuse(soft, (0, 0, 0), (0, 0, 1)) == pytest.approx([share] * 3, rel=0.01)


def test_beam_limits_a_lamp_to_its_cone():
    corners = OCTAHEDRON * 0.05 + np.float32((0, 0, 1))
    inside, outside = (lit_by(corners, axis=axis, cosine=(0.7, 0.8)) for axis in ((0, 0, -1), (0, 0, 1)))
    assert diffuse(inside, (0, 0, 0), (0, 0, 1))[0] > 0
    assert diffuse(outside, (0, 0, 0), (0, 0, 1))[0] == 0


@pytest.mark.parametrize("radius", [0.05, 0.15])
def test_the_edge_of_a_beam_is_as_soft_as_the_parts_of_the_lamp_make_it(radius):
    """Beside the mean of small lamps on a disk, whose edges are sharp."""
    cosine, axis = torch.tensor([[math.cos(0.4), math.cos(0.38)]]), torch.tensor([[0.0, 0, -1]])
    angle, turn = torch.linspace(0, 0.8, 60), torch.arange(2000) * 2.399963
    toward = torch.stack([angle.sin(), 0 * angle, angle.cos()])
    on_disk = torch.arange(0.5, 2000).div(2000).sqrt() * radius * torch.stack([turn.cos(), turn.sin()])
    part = toward[..., None] + F.pad(on_disk, (0, 0, 0, 1))[:, None]
    sharp = beam(part / part.norm(dim=0), torch.zeros(60, 2000), axis.expand(2000, 3), cosine.expand(2000, 2))
    soft = beam(toward[..., None], torch.full((60, 1), radius**2), axis, cosine)[:, 0]
    assert (soft - sharp.mean(1)).abs().max() < 0.12
    assert (soft * angle.sin()).sum() == pytest.approx((sharp.mean(1) * angle.sin()).sum().item(), rel=0.05)


def test_fine_emissive_meshes_are_merged_without_losing_light():
    grid = [[(i, j, 0), (i + 1, j, 0), (i, j + 1, 0)] for i in range(20) for j in range(20)]
    grid += [[(i + 1, j + 1, 0), (i, j + 1, 0), (i + 1, j, 0)] for i in range(20) for j in range(20)]
    corners = np.float32(grid) / 20 - (0.5, 0.5, -2)
    assert len(gather_emitters(lit_by(corners)).corners) <= 8
    expected = integrated_irradiance(corners, np.zeros(3), np.array((0, 0, 1.0)), samples=4) / math.pi
    assert diffuse(lit_by(corners), (0, 0, 0), (0, 0, 1))[0] == pytest.approx(expected, rel=0.05)


def test_environment_irradiance_and_mirror_reflection():
    rng = np.random.default_rng(0)
    coarse = np.kron(rng.random((8, 16, 3)), np.ones((32, 32, 1)))
    environment = EnvironmentLight(torch.tensor(coarse, dtype=torch.float32))
    directions, weights = direction_map(256, 512), solid_angles(256, 512).numpy()
    n = np.float32([[0, 0, 1], [0.6, 0.0, 0.8], [0, -1, 0]])
    expected = np.stack([(coarse * ((directions @ k).clip(0) * weights)[..., None]).sum((0, 1)) for k in n])
    np.testing.assert_allclose(environment.irradiance(torch.tensor(n)), expected, rtol=0.04)
    looking = torch.tensor(directions[[48, 112, 240], [16, 240, 496]])
    seen = environment.filtered(looking, torch.zeros(3))
    np.testing.assert_allclose(seen, coarse[[48, 112, 240], [16, 240, 496]], atol=1e-3)


@pytest.mark.parametrize("elevation", [-10, 2, 8, 30, 80])
def test_a_glow_near_the_horizon_lights_the_ground_by_the_cosine(elevation):
    """Nine spherical harmonics would have half again as much from one that is 5 degrees high, and some from below."""
    rows, columns = 256, 512
    sky = torch.zeros(rows, columns, 3)
    row = round((90 - elevation) / 180 * rows)
    sky[row - 2:row + 2, 100:140] = 1
    glow = torch.from_numpy(direction_map(rows, columns)), solid_angles(rows, columns)[..., None]
    expected = (sky * glow[0][..., 2:].clamp_min(0) * glow[1]).sum((0, 1))
    light = EnvironmentLight(sky).irradiance(torch.tensor([[0.0, 0, 1]]))[0]
    np.testing.assert_allclose(light, expected, rtol=0.1, atol=1e-5)


@pytest.mark.parametrize(("roughness", "cosine"), [(0.3, 0.9), (0.3, 0.2), (0.6, 0.5), (0.6, 0.15), (1.0, 0.3)])
def test_lobes_mirror_as_much_of_the_sky_as_they_reach_also_at_grazing_angles(roughness, cosine):
    """Beside a sum over the whole map with the lobe's own density: a bright sky on the far side, a dim one here."""
    directions, weights = torch.from_numpy(direction_map(64, 128)).reshape(-1, 3), solid_angles(64, 128).expand(64, 128)
    radiance = 0.1 + directions[:, :1].clamp_min(0) + (directions[:, 2:] > 0.5) * torch.tensor([0.0, 1.0, 3.0])
    n, v = torch.tensor([[0.0, 0, 1]]), torch.tensor([[-math.sqrt(1 - cosine**2), 0, cosine]])
    half = F.normalize(directions + v, dim=1)
    alpha2, n_l = roughness**4, directions[:, 2].clamp_min(0)
    density = alpha2 / (half[:, 2].square() * (alpha2 - 1) + 1).square()
    root = lambda c: (alpha2 + (1 - alpha2) * c * c).sqrt()  # noqa: E731
    lobe = density * n_l / (n_l * root(torch.tensor(cosine)) + cosine * root(n_l)).clamp_min(1e-6) * weights.flatten()
    expected = (lobe[:, None] * radiance).sum(0) / lobe.sum()
    found = EnvironmentLight(radiance.view(64, 128, 3)).reflected(n, v, torch.tensor([roughness]), torch.ones(1))[0]
    torch.testing.assert_close(found, expected, rtol=0.06, atol=0.01)


def test_rough_surfaces_mirror_the_mean_of_what_is_around():
    coarse = np.random.default_rng(1).random((32, 64, 3))
    looking, weights = direction_map(32, 64), solid_angles(32, 64).numpy()[..., None]
    at = [4, 16, 27], [5, 40, 63]
    seen = EnvironmentLight(torch.tensor(coarse, dtype=torch.float32)).filtered(
        torch.tensor(looking[at]), torch.full((3,), 0.75))
    lobe = [(1 + looking @ towards)[..., None] / 2 * (0.75 ** 4 - 1) + 1 for towards in looking[at]]
    share = [(looking @ towards).clip(0)[..., None] / each ** 2 * weights
             for towards, each in zip(looking[at], lobe, strict=True)]
    expected = [(each * coarse).sum((0, 1)) / each.sum() for each in share]
    np.testing.assert_allclose(seen, expected, rtol=0.05)


def test_mirrors_show_the_sky_as_sharp_as_its_map():
    """One texel of the map shines."""
    radiance = torch.zeros(256, 512, 3)
    radiance[100, 300] = 1
    looking = torch.tensor(direction_map(256, 512)[[100, 100], [300, 302]])
    seen = EnvironmentLight(radiance).filtered(looking, torch.zeros(2))
    assert seen[0].min() > 0.99 and seen[1].max() < 0.01


def test_a_pixel_of_a_bent_mirror_shows_the_mean_of_what_it_mirrors():
    """Stripes of the sky, an eighth of a radian wide, in a mirror that turns by a quarter from pixel to pixel."""
    directions = torch.from_numpy(direction_map(256, 512))
    azimuth = torch.atan2(directions[..., 1], directions[..., 0])
    sky = EnvironmentLight((torch.sin(8 * math.pi * azimuth) > 0).float()[..., None].expand(-1, -1, 3))
    angle = torch.linspace(-1, 1, 200)
    n = torch.stack([angle.cos(), angle.sin(), 0 * angle], 1)
    flat = torch.zeros(len(n), 2, 9)
    bent = flat.clone()
    bent[:, 0, 4] = 0.25
    found = [sky.reflected(n, torch.tensor([[1.0, 0, 0]]).expand_as(n), torch.zeros(200), torch.ones(200), footprint)
             for footprint in (flat, bent)]
    assert found[0].std() > 0.45 and found[1].std() < 0.2
    assert found[1].mean().item() == pytest.approx(0.5, abs=0.05)


def test_a_sun_shines_alike_on_near_and_far_ground():
    sun = floor_scene()
    sun.triangles[sun.is_light] = (sun.triangles[sun.is_light] - np.float32((0, 0, 2))) * 25 + np.float32((0, 0, 50))
    points = torch.tensor([[0.0, 0.0, 0.0], [300.0, 0.0, 0.0], [0.0, -5000.0, 0.0]])
    up = torch.tensor([[0.0, 0.0, 1.0]]).expand(3, 3)
    light = DirectLight(sun).lobes(points, up, up, torch.ones(3), torch.ones(3))[0]
    assert light[0].min() > 0
    torch.testing.assert_close(light[1:], light[:1].expand(2, 3), rtol=0.02, atol=0)


def test_the_strongest_emitters_are_found_with_their_directions_and_shares():
    lamp = OCTAHEDRON * 0.1
    near, far, sun = lamp + np.float32((0, 0, 1)), lamp + np.float32((2, 0, 1)), lamp * 100 + np.float32((0, 300, 300))
    below = lamp - np.float32((0, 0, 1))
    scene = lit_by(np.concatenate([near, far, sun, below]))
    scene.emission[8:16] = (4.0, 0.0, 0.0)
    x, n = torch.zeros(1, 3), torch.tensor([[0.0, 0, 1]])
    found = DirectLight(scene).strongest_emitters(x, n)[0]
    toward, nearness, share = (found[:, EMITTER[name]] for name in ("toward", "nearness", "share"))
    place = {name: int((toward @ torch.nn.functional.normalize(torch.tensor(to), dim=0)).argmax()) for name, to in
             {"near": (0.0, 0, 1), "far": (2.0, 0, 1), "sun": (0.0, 1, 1)}.items()}
    assert place["near"] == 0 and set(place.values()) == {0, 1, 2}
    torch.testing.assert_close(toward.norm(dim=1), torch.ones(3))
    assert nearness[place["near"]].item() == pytest.approx(0.5, abs=1e-3) and nearness[place["sun"]] == 0
    torch.testing.assert_close(share.sum(0), torch.ones(3))
    assert share[place["far"]].tolist()[1:] == [0, 0]

    lone = DirectLight(lit_by(near, environment=np.full((16, 32, 3), 0.01, np.float32))).strongest_emitters(x, n)[0]
    assert (lone[1:] == 0).all() and 0 < lone[0, EMITTER["share"]].max() < 1
