# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of lamps that glass bends."""
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.geometry import area_vectors, unit
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.caustics.photon_map import PhotonMap
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.material import reflectance
from renderformer_v2.model.scene import RenderScene, constant_tile
from tests.model.samples import flat, floor_scene

UP = torch.tensor([[0.0, 0.0, 1.0]])
GLASS = {"transmission": 1.0, "ior": 1.5, "roughness": 0.0}
MIDDLE = torch.tensor([[0.0, 0.0, 0.0]])
AROUND = torch.cat([torch.rand(100, 2, generator=torch.Generator().manual_seed(0)) * 0.4 - 0.2, torch.zeros(100, 1)], 1)


def of_glass(corners: np.ndarray, color=(1.0, 1.0, 1.0), **material) -> RenderScene:
    scene = flat(np.float32(corners), color)
    scene.tiles[:] = constant_tile(color, **GLASS | material)
    scene.normals[:] = unit(area_vectors(scene.triangles))[:, None]
    return scene


def pane(height: float, thickness: float, half: float = 1.0) -> np.ndarray:
    """(12, 3, 3) of a box of glass across z, whose faces look out."""
    square = np.float32([[(-1, -1, 1), (1, -1, 1), (1, 1, 1)], [(-1, -1, 1), (1, 1, 1), (-1, 1, 1)]])
    sides = np.concatenate([np.roll(square * np.float32((1, 1, z)), axis, axis=-1)[:, ::int(z)]
                            for axis in range(3) for z in (1, -1)])
    return sides * np.float32((half, half, thickness / 2)) + np.float32((0, 0, height))


def ball(radius: float, segments=24) -> np.ndarray:
    """(4 segments^2, 3, 3) of a sphere around the origin."""
    theta, phi = np.linspace(0, np.pi, segments + 1), np.linspace(0, 2 * np.pi, 2 * segments + 1)
    at = lambda i, j: (np.sin(theta[i]) * np.cos(phi[j]), np.sin(theta[i]) * np.sin(phi[j]),  # noqa: E731
                       np.cos(theta[i]))
    return np.float32([t for i in range(segments) for j in range(2 * segments) for t in (
        (at(i, j), at(i + 1, j), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i, j + 1)))]) * radius


def light_on_floor(scene: RenderScene) -> torch.Tensor:
    """(3,) radiance of the middle of a floor, if it were white, by photons."""
    return Radiosity(scene, DirectLight(scene)).caustics.radiance(AROUND, UP.expand(100, 3)).mean(0)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, -0.6, 0.8), (0.6, 0.6, -0.53)])
def test_photons_that_lie_evenly_light_a_surface_evenly_however_it_is_turned(normal):
    normal = F.normalize(torch.tensor([normal]), dim=-1)
    u = F.normalize(torch.linalg.cross(normal, torch.tensor([[0.3, 0.2, -0.9]])), dim=-1)
    v = torch.linalg.cross(normal, u)
    side, spacing = 300, 1 / 300
    place = (torch.arange(side) + 0.5) * spacing - 0.5
    x, y = (each.reshape(-1, 1) for each in torch.meshgrid(place, place, indexing="ij"))
    flux = torch.tensor([[1.0, 2.0, 3.0]]) * spacing**2
    photons = PhotonMap(x * u + y * v, normal.expand(side**2, 3), flux.expand(side**2, 3))
    at = 0.6 * (torch.rand(500, 2, generator=torch.Generator().manual_seed(0)) - 0.5)
    points, normals = at[:, :1] * u + at[:, 1:] * v, normal.expand(500, 3)
    found = photons.radiance(points, normals)
    torch.testing.assert_close(found * torch.pi, torch.tensor([[1.0, 2.0, 3.0]]).expand(500, 3), rtol=0.05, atol=0)
    assert photons.radiance(points, -normals).abs().max() == 0  # the other side is dark
    assert photons.radiance(points + normal, normals).abs().max() == 0  # and what is above


@pytest.mark.parametrize("radius", [0.15, 0.03, 0.006])
def test_photons_light_small_balls_as_much_as_large_ones(radius):
    count, random = 20000, np.random.default_rng(0)
    corners = ball(radius)
    area = np.linalg.norm(area_vectors(corners), axis=1)
    row = random.choice(len(corners), count, p=area / area.sum())
    weights = random.dirichlet((1, 1, 1), count)
    at, normal = np.einsum("nk,nkc->nc", weights, corners[row]), unit(area_vectors(corners))[row]
    at, normal = torch.from_numpy(np.float32(at)), torch.from_numpy(normal)
    found = PhotonMap(at, normal, torch.full((count, 3), area.sum() / count), corners).radiance(at[:999], normal[:999])
    torch.testing.assert_close(found.mean(0) * torch.pi, torch.ones(3), rtol=0.05, atol=0)
    assert found.std() < 0.2 * found.mean()


@pytest.mark.parametrize(("half", "border"), [(0.2, 1.0), (1e4, 0.5)])
def test_photons_at_a_border_of_a_surface_light_all_of_it_and_fade_where_it_goes_on(half, border):
    at = F.pad(torch.rand(20000, 2, generator=torch.Generator().manual_seed(0)) * 0.4 - 0.2, (0, 1))
    corners = half * np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
    photons = PhotonMap(at, UP.expand(20000, 3), torch.full((20000, 3), 0.16 / 20000), corners)
    along = torch.stack([torch.full((100,), 0.1999), torch.linspace(-0.15, 0.15, 100), torch.zeros(100)], 1)
    found = photons.radiance(along, UP.expand(100, 3)).mean().item() * np.pi
    assert found == pytest.approx(border, abs=0.12)


def test_photons_all_over_a_wide_ground_leave_a_focus_as_it_is():
    """Of so much ground the area could not be measured finely enough."""
    random = torch.Generator().manual_seed(0)
    focus, around = (torch.rand(count, 2, generator=random) * width - width / 2 for count, width in (
        (10_000, 0.4), (3000, 20)))
    at = F.pad(torch.cat([focus, around]), (0, 1))
    ground = 20 * np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
    photons = PhotonMap(at, UP.expand(13_000, 3), torch.full((13_000, 3), 0.16 / 10_000 * np.pi), ground)
    found = photons.radiance(AROUND * 0.7, UP.expand(100, 3))
    torch.testing.assert_close(found, torch.ones(100, 3), rtol=0.3, atol=0)


def test_few_photons_are_spread_far_and_many_stay_where_they_are():
    at = torch.tensor([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    few, many = (PhotonMap(*(x.expand(count, 3) for x in (MIDDLE, UP, torch.ones(1, 3) / count)))
                 .radiance(at, UP.expand(2, 3))[:, 0] for count in (4, 4000))
    assert few[1] > 0.05 * few[0] > 0 and many[1] < 1e-3 * many[0]


def test_a_thin_pane_passes_what_fresnel_leaves_of_the_light_of_a_lamp(monkeypatch):
    """And of its colour each of both surfaces has the square root."""
    monkeypatch.setattr(reflectance, "BLURRED", 1e-3)
    floor = floor_scene()
    unshaded = DirectLight(floor).diffuse(AROUND, UP.expand(100, 3)).mean(0)
    color = torch.tensor([0.9, 0.5, 0.1])
    found = light_on_floor(floor.appended(of_glass(pane(0.3, 0.01), color.tolist())))
    through = 0.96 * 0.96 * (1 + 0.04 ** 2 * color.square())  # what is mirrored twice inside passes too
    torch.testing.assert_close(found, unshaded * color * through, rtol=0.05, atol=0)


def test_a_lamp_in_glass_is_as_bright_outside_as_it_is_inside(monkeypatch):
    """As in Cycles, which follows paths from the camera and lets radiance pass: physically it would be 1 / n^2 of that.

    Half of the way is in glass, which makes it shorter by n.
    """
    monkeypatch.setattr(reflectance, "BLURRED", 1e-3)
    floor = floor_scene()
    unshaded = DirectLight(floor).diffuse(AROUND, UP.expand(100, 3)).mean(0)
    found = light_on_floor(floor.appended(of_glass(pane(2, 2))))
    torch.testing.assert_close(found, unshaded * 0.96 * (2 / (1 + 1 / 1.5)) ** 2, rtol=0.05, atol=0)


def test_a_ball_gathers_light_and_a_blurred_one_less():
    floor, found = floor_scene(), []
    unshaded = DirectLight(floor).diffuse(MIDDLE, UP)[0, 0].item()
    normals = ball(1)
    scene = floor.appended(of_glass(ball(0.1) + np.float32((0, 0, 0.17))))
    scene.normals[len(floor):] = normals
    for blurred in (0.02, reflectance.BLURRED):
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(reflectance, "BLURRED", blurred)
            found.append(Radiosity(scene, DirectLight(scene)).caustics.radiance(MIDDLE, UP)[0, 0].item())
    assert found[0] > 3 * unshaded and found[0] > 2 * found[1] > 0


def test_what_stands_between_lamp_and_glass_takes_its_light():
    glass, floor = of_glass(pane(0.3, 0.01)), floor_scene()
    plate = flat(np.float32(pane(0.4, 0.01)), (0.5, 0.5, 0.5))
    assert light_on_floor(floor.appended(glass)).min() > 0
    assert light_on_floor(floor.appended(glass).appended(plate)).abs().max() == 0


@pytest.mark.parametrize(("lit_groups", "arrives"), [(0b01, False), (0b10, True)])
def test_a_light_shines_through_the_glass_that_it_lights(lit_groups, arrives):
    """As in Cycles, where light linking of what ends at a light is that of the surface before: the glass."""
    floor = floor_scene()
    scene = floor.appended(of_glass(pane(0.3, 0.01)))
    scene.group = np.where(np.arange(len(scene)) < len(floor), 0, 1).astype(np.uint8)
    scene.lit_groups = np.full(len(scene), lit_groups, np.uint64)
    assert bool(light_on_floor(scene).any()) == arrives


def test_metal_and_what_lets_light_straight_on_bend_none():
    for material in ({"metallic": 1.0}, {"ior": 1.0}, {"transmission": 0.0}):
        assert light_on_floor(floor_scene().appended(of_glass(pane(0.3, 0.01), **material))).abs().max() == 0


def test_light_that_glass_gathers_bounces_on():
    """From the floor, all under the glass, back to where no lamp is seen."""
    under, found = torch.tensor([[0.0, 0.0, 0.2]]), []
    for plate in of_glass(pane(0.3, 0.01, half=1.5)), flat(np.float32(pane(0.3, 0.01, half=1.5)), (0.0, 0.0, 0.0)):
        scene = floor_scene().appended(plate)
        found.append(Radiosity(scene, DirectLight(scene)).diffuse(under, -UP).indirect[0])
    assert (found[0] > 0.005).all() and (found[0] > 5 * found[1]).all()


def test_without_refractive_caustics_glass_sends_no_light_to_matte_surfaces():
    under = torch.tensor([[0.0, 0.0, 0.2]])
    scene = floor_scene().appended(of_glass(pane(0.3, 0.01, half=1.5)))
    dark = replace(scene, caustics=np.array([True, False]))
    assert light_on_floor(dark).abs().max() == 0
    down, up = (Radiosity(dark, DirectLight(dark)).diffuse(under, normal).indirect.max() for normal in (UP, -UP))
    assert down < 0.005 and up < 0.005


def test_half_the_photons_give_the_same_light(monkeypatch):
    scene, found = floor_scene().appended(of_glass(pane(0.3, 0.05), roughness=0.7)), []
    for count in (1 << 15, 1 << 16):
        monkeypatch.setattr("renderformer_v2.model.light.bounce.radiosity.PHOTONS", count)
        found.append(light_on_floor(scene))
    torch.testing.assert_close(*found, rtol=0.1, atol=0)


def test_light_stays_on_a_surface_beside_which_another_is_dark():
    """Of a table just above a floor, photons light the top, and not what is below."""
    at = torch.cat([torch.rand(20000, 2, generator=torch.Generator().manual_seed(0)) - 0.5, torch.zeros(20000, 1)], 1)
    photons = PhotonMap(at, UP.expand(20000, 3), torch.full((20000, 3), 1 / 20000))
    middle = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, -0.04], [0.0, 0.0, 0.04]])
    found = photons.radiance(middle, UP.expand(3, 3))[:, 0]
    assert found[0].item() == pytest.approx(1 / np.pi, rel=0.2) and found[1:].abs().max() == 0


def test_milky_glass_is_lit_from_within_and_clear_glass_is_not():
    """On the inner side of a ball's far wall, where a lamp's light arrives through the near one."""
    for transmission, lit in (0.6, True), (0.9, False):
        scene = floor_scene().appended(of_glass(pane(0.3, 0.2, half=0.3), transmission=transmission))
        bounce = Radiosity(scene, DirectLight(scene))
        found = bounce.caustics.radiance(torch.tensor([[0.05, 0.03, 0.2]]), UP)
        assert (found.min() > 0) == lit


def test_glass_alone_sends_its_light_nowhere():
    glass = of_glass(pane(0.0, 0.2, half=0.3))
    lamp = floor_scene()
    lamp = replace(lamp, **{name: getattr(lamp, name)[lamp.is_light] for name in
                            ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")})
    assert light_on_floor(lamp.appended(glass)).abs().max() == 0


def test_a_floor_that_glass_touches_gets_all_that_passes():
    floor, found = floor_scene(), []
    for height in 0.05, 0.051:
        found.append(light_on_floor(floor.appended(of_glass(pane(height, 0.1)))))
    torch.testing.assert_close(*found, rtol=0.1, atol=0)


def test_even_light_of_random_photons_is_smooth_and_its_border_sharp():
    count, generator = 60_000, torch.Generator().manual_seed(3)
    at = torch.cat([torch.rand(count, 2, generator=generator) * 0.5, torch.zeros(count, 1)], 1)
    photons = PhotonMap(at, UP.expand(count, 3), torch.full((count, 3), np.pi * 0.25 / count))
    x = torch.linspace(0.1, 0.9, 801)
    across = torch.stack([x, torch.full_like(x, 0.25), torch.zeros_like(x)], 1)
    light = photons.radiance(across, UP.expand(801, 3))[:, 0]
    inside = light[x < 0.46]
    assert inside.mean() == pytest.approx(1, abs=0.03)
    assert inside.std() < 0.05  # of some 60 photons to a node of the finest grid, which are 13 %
    assert (light[x > 0.53] < 0.1).all()
