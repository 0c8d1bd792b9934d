# SPDX-License-Identifier: GPL-3.0-or-later
"""Indirect light by radiosity: what is known about it without a renderer."""
import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import area_vectors
from renderformer_v2.model.light.bounce import patches, radiosity
from renderformer_v2.model.light.bounce.panes import ENTERING, token_transmittances
from renderformer_v2.model.light.bounce.patches import make_patches
from renderformer_v2.model.light.bounce.radiosity import GlossyLight, Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight, Visibility
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, RenderScene, constant_tile
from tests.model.light.bounce.test_patches import patches_of
from tests.model.no_host_copies import NoHostCopies
from tests.model.samples import closed_box, flat, floor_scene, walls, with_black_lamps

MANY = 50  # times the rays of a point
RATIO = 0.5 / 0.3  # of half the side of `roof` to its height
COVERED = 4 / (2 * np.pi) * 2 * RATIO / np.sqrt(1 + RATIO**2) * np.arctan(RATIO / np.sqrt(1 + RATIO**2))  # by it
UP = torch.tensor([[0.0, 0.0, 1.0]])


def built(scene: RenderScene) -> Radiosity:
    return Radiosity(scene, DirectLight(scene))


def with_leaving(bounce: Radiosity, leaving: torch.Tensor) -> Radiosity:
    """With other radiance (sides, 1 or 3) that leaves the patches."""
    changed = copy(bounce)
    changed.leaving = leaving.expand(-1, 3)
    changed._of_lobes = changed._bounced_last = torch.zeros_like(changed.leaving)
    return changed


def arriving(bounce: Radiosity, points, normals) -> torch.Tensor:
    """(P, 3) indirect light, without the noise of a point's few rays."""
    points, normals = torch.as_tensor(points), torch.as_tensor(normals).expand(len(points), 3)
    return bounce.diffuse(points.repeat(MANY, 1), normals.repeat(MANY, 1)).indirect.view(MANY, -1, 3).mean(0)


def parts(bounce: Radiosity, points, normals) -> tuple[torch.Tensor, torch.Tensor]:
    """(P, 3) all of it, and what has bounced diffusely before."""
    return tuple(arriving(x, points, normals) for x in (bounce, with_leaving(bounce, bounce.bounced_before)))


def test_bounces_between_patches_never_wait_for_a_card(monkeypatch):
    calls = []

    def watched(*inputs, real=radiosity.bounce):
        with NoHostCopies():
            calls.append(real(*inputs))
        return calls[-1]

    monkeypatch.setattr(radiosity, "bounce", watched)
    built(walls((0.9, 0.1, 0.1)))
    assert len(calls) == 1 and all(light.max() > 0 for light in calls[0])


def test_a_point_that_faces_a_bright_plane_gathers_its_radiance():
    bounce = built(with_black_lamps(floor_scene(side=2)))
    bounce = with_leaving(bounce, torch.ones_like(bounce.leaving))
    near, far = (arriving(bounce, [[0.05, 0.03, z]], -UP)[0, 0].item() for z in (0.2, 3.0))
    # A square of side 2 at distance z: its form factor by the formula for parallel differential areas.
    for z, found, error in ((0.2, near, 0.02), (3.0, far, 0.1)):
        x = 1 / z
        expected = 4 / (2 * np.pi) * 2 * x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x))
        assert found == pytest.approx(expected, rel=error)
    lamp = built(with_black_lamps(floor_scene())).diffuse(torch.tensor([[0.0, 0.0, 0.5]]), UP)
    assert lamp.indirect.abs().max() == 0


def test_a_coloured_wall_bleeds_onto_what_is_near_it():
    bounce = built(walls((0.8, 0.05, 0.05)))
    near, far = arriving(bounce, [[-0.8, 0.0, 0.0], [0.9, 0.0, 0.0]], UP)
    assert near[0] > 3 * near[1] > 0 and near[0] > 2 * far[0] > 0


def test_light_that_has_bounced_before_is_known_apart():
    """Over the floor alone there is none; between floor and wall it is what the other sends back, and of its colour."""
    at, towards = [[-0.8, 0.0, 0.3]], -UP
    once, again = parts(built(floor_scene(side=6)), at, towards)
    assert once.min() > 0 and again.abs().max() < 1e-3 * once.min()
    total, again = parts(built(walls((0.8, 0.05, 0.05))), at, towards)
    red, green, _ = again[0]
    assert 0 < green < red / 3 and red < 0.5 * total[0, 0]


def test_what_metals_send_to_each_other_is_not_told_apart_because_traced_light_has_it():
    scene = walls((0.8, 0.05, 0.05))
    scene.tiles[:, METALLIC] = 1
    total, again = parts(built(scene), [[-0.8, 0.0, 0.3]], -UP)
    assert total.min() > 0 and again.abs().max() < 1e-4 * total.max()


def test_no_more_than_a_whole_hemisphere_arrives():
    bounce = built(walls((0.8, 0.8, 0.8)))
    bounce = with_leaving(bounce, torch.ones_like(bounce.leaving))
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 2 - 1
    normals = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    assert arriving(bounce, points, normals).max() <= 1.03  # of a few aimed rays, too many may meet what they aim at


def test_merged_patches_give_nearly_the_same_light(monkeypatch):
    """Coarse walls beside a thin plate of many small triangles that face up and down."""
    fine = floor_scene(side=24).triangles[:-1] * 0.3 + np.float32((0.5, 0, 0.5))
    plate = flat(np.concatenate([fine, fine[:, ::-1] - np.float32((0, 0, 0.01))]), (0.2, 0.6, 0.8))
    scene = walls((0.8, 0.05, 0.05)).appended(plate)
    points = torch.tensor([[0.3, 0.2, 0.0], [-0.5, 0.5, 0.0], [0.8, -0.6, 0.0]])
    exact = arriving(built(scene), points, UP)
    monkeypatch.setattr(patches, "PATCHES", 512)
    few = built(scene)
    assert 256 < few.gather_scene.count <= 768 < len(scene)
    torch.testing.assert_close(arriving(few, points, UP), exact, rtol=0.1, atol=1e-3)


@pytest.mark.parametrize("side", [2, 40])
def test_a_ground_to_the_horizon_lights_what_stands_on_it_as_an_endless_one(side):
    """Coarse, so that it is split, and fine, so that it is merged: a wall sees it in half of its hemisphere."""
    ground = floor_scene(side).triangles[:-1] * np.float32((2000, 2000, 0)) - np.float32((0, 0, 0.2))
    bounce = built(flat(ground, (0.5, 0.5, 0.5)))
    bounce = with_leaving(bounce, torch.ones_like(bounce.leaving))
    wall = torch.tensor([[0.0, -1.0, 0.0]])
    for height in (-0.1, 0.0, 0.3):
        assert arriving(bounce, [[0.1, 0.2, height]], wall)[0, 0].item() == pytest.approx(0.5, abs=0.06)


def roof(color, **material) -> RenderScene:
    """A plate above the floor's middle."""
    corners = np.float32([[[-1, -1, 0], [1, 1, 0], [1, -1, 0]], [[-1, -1, 0], [-1, 1, 0], [1, 1, 0]]])
    return replace(flat(corners * 0.5 + np.float32((0, 0, 0.3)), color), tiles=constant_tile(color, **material)[None])


def test_light_falls_on_patches_by_shading_normals_as_in_cycles():
    scenes = with_black_lamps(floor_scene()), with_black_lamps(floor_scene())
    scenes[1].normals[:] = (0.6, 0, 0.8)
    level, tilted = (built(scene).leaving for scene in scenes)
    middle = patches_of(scenes[0]).center.norm(dim=-1) < 0.3
    front = middle.nonzero()[:, 0]
    assert (tilted[front].mean() / level[front].mean()).item() == pytest.approx(0.8, abs=0.02)


def test_what_stands_in_between_keeps_light_away():
    """A black plate between the floor's middle and a bright ceiling."""
    ceiling = flat(floor_scene(side=6).triangles[:-1] * np.float32((1, 1, 0)) + np.float32((0, 0, 0.55)), (0.8,) * 3)
    light = []
    for scene in (ceiling, ceiling.appended(roof((0.0, 0.0, 0.0)))):
        bounce = built(scene)
        bright = patches_of(scene).center[:, 2] > 0.5
        bounce = with_leaving(bounce, bright.float().repeat(2)[:, None])
        light.append(arriving(bounce, [[0.0, 0.0, 0.0], [0.0, 0.0, 0.45]], UP)[:, 0])
    assert light[1][0] < 0.4 * light[0][0] and light[1][1] > 0.9


@pytest.mark.parametrize("material, share", [
    ({"transmission": 1.0}, 1.0), ({"transmission": 0.75}, 0.75), ({"transmission": 1.0, "metallic": 0.8}, 0.0)])
def test_a_wall_behind_glass_is_tinted_by_what_passes_and_one_behind_metal_is_not_seen(material, share):
    """By one surface, of which the colour's root. Metallic weighs more than transmission, as in Principled BSDF."""
    above = floor_scene(side=6).triangles[:-1] * np.float32((1, 1, 0)) + np.float32((0, 0, 0.55))
    color = np.float32((0.8, 0.4, 0.1))
    scene = flat(above, (0.8,) * 3).appended(roof(color, ior=1.5, **material))
    bounce = built(scene)
    bright = patches_of(scene).center[:, 2] > 0.5
    bounce = with_leaving(bounce, bright.float().repeat(2)[:, None])
    found = arriving(bounce, [[0.0, 0.0, 0.29]], UP)[0]
    np.testing.assert_allclose(found, share * token_transmittances(scene)[-1, ENTERING] * color ** 0.5, atol=0.06)


@pytest.mark.parametrize("ior, share", [(1.5, 0.8 ** 0.5), (1.0, 0.0)])
def test_sky_seen_through_coloured_glass_lights_what_is_behind_and_straight_through_panes_it_does_already(ior, share):
    """One surface of glass is passed; an ior of 1 lets light pass straight, which direct light contains."""
    scene = roof((0.8, 0.8, 0.8), transmission=1.0, ior=ior, roughness=0.0)
    scene.environment = np.full((256, 512, 3), 2.0, np.float32)
    bounce, direct = built(scene), DirectLight(scene)
    found = arriving(bounce, [[0.0, 0.0, 0.0]], UP)[0, 0].item()
    share *= token_transmittances(scene)[-1, ENTERING]
    assert found == pytest.approx(2 * share * COVERED, abs=0.12)
    sky = direct.visibility(torch.zeros(1, 3), UP).sky[0, 0].item()
    straight = COVERED * 0.8 ** 0.5 if ior == 1 else 0
    assert sky == pytest.approx(1 - COVERED + straight, abs=0.06)


def test_a_scene_of_lights_alone_gathers_nothing():
    scene = floor_scene()
    lights = scene.is_light
    alone = replace(scene, **{name: getattr(scene, name)[lights] for name in
                              ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")})
    bounce, points = built(alone), torch.zeros(3, 3)
    assert (bounce.diffuse(points, torch.eye(3)).indirect == 0).all()
    assert [x.shape for x in bounce.diffuse(points[:0], points[:0])[::2]] == [(0, 3)] * 2


def test_a_small_bright_surface_lights_evenly_because_rays_aim_at_it():
    """A ten-thousandth of the hemisphere, which one of a hundred points would see by rays all around."""
    wall = floor_scene(side=8).triangles[:-1] * np.float32((1, 1, 0))
    bright = floor_scene(side=1).triangles[:-1] * np.float32((0.01, 0.01, 0)) + np.float32((0, 0, 0.5))
    bounce = built(flat(np.concatenate([wall, bright]), (0.5, 0.5, 0.5)))
    gather_scene = bounce.gather_scene
    shines = torch.zeros(2 * gather_scene.count)
    corners = gather_scene.corners
    rows = gather_scene.patch[:len(corners)][corners[..., 2].amin(1) > 0.4]
    shines[rows] = shines[rows + len(shines) // 2] = 1.0
    bounce = with_leaving(bounce, shines[:, None])
    at = torch.rand(512, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([0.02, 0.02, 0])
    by_chance = bounce.diffuse(at, UP.expand(512, 3)).indirect[:, 0]
    gather_scene.aim(shines)
    aimed = bounce.diffuse(at, UP.expand(512, 3)).indirect[:, 0]
    expected = np.linalg.norm(area_vectors(bright), axis=-1).sum() / (math.pi * 0.5 ** 2)
    assert aimed.mean().item() == pytest.approx(expected, rel=0.1)
    assert aimed.std() < 0.1 * expected < by_chance.std()


def test_all_light_of_a_lamp_arrives_in_a_closed_box():
    scene = closed_box((0.5, 0.5, 0.5))
    scene.tiles[:, IOR] = 1
    direct = DirectLight(scene)
    bounce, made = Radiosity(scene, direct), make_patches(scene, direct.emitters.near())
    area = made.vector.norm(dim=-1)[:, None]
    first = bounce.leaving - bounce.bounced_before
    arrived = sum((area * side / 0.5).sum(0) for side in first.split(len(area)))
    emitters = direct.emitters
    sheets = 2 * np.linalg.norm(area_vectors(emitters.shapes.corners.numpy()), axis=-1)
    emitted = torch.from_numpy(np.float32(sheets)) @ emitters.radiance[:len(sheets)]  # by both sides, over pi
    emitted = emitted + 4 * np.pi * emitters.shapes.radii.square() @ emitters.radiance[len(sheets):]
    torch.testing.assert_close(arrived, emitted, rtol=0.05, atol=0)


def test_light_between_white_walls_adds_up_as_the_series_of_its_bounces():
    """In a closed box nearly all of it is the same everywhere: four diffuse bounces, and glossy ones between them."""
    scene = closed_box((0.8, 0.8, 0.8))
    scene.tiles[:, ROUGHNESS] = 0.9
    direct = DirectLight(scene)
    bounce, made = Radiosity(scene, direct), make_patches(scene, direct.emitters.near())
    diffuse, _, glossy = made.albedo[0].view(3, 3)[:, 0].tolist()
    area = made.vector.norm(dim=-1)[:, None]
    every, again = ((area.repeat(2, 1) * light).sum().item() for light in (bounce.leaving, bounce.bounced_before))
    series = sum(math.comb(d + g, g) * diffuse ** d * glossy ** g for d in range(4) for g in range(3))
    assert again / (every - again) == pytest.approx(series - 1, rel=0.05)


def test_what_a_glossy_surface_shows_has_bounced_diffusely_once_more():
    """As in Cycles: glossy and diffuse bounces are counted apart. What paths from the diffuse lobe bring has not."""
    scene = closed_box((0.8, 0.8, 0.8))
    scene.tiles[:, ROUGHNESS] = 0.9
    bounce, made = built(scene), make_patches(scene, DirectLight(scene).emitters.near())
    most = np.array(list(scene.most_bounces.values()))
    again = built(replace(scene, bounces=most - (1, 0, 0, 0)))
    area = made.vector.norm(dim=-1)[:, None].repeat(2, 1)
    last, before, once_less = ((area * light).sum().item() for light in (
        bounce._bounced_last, bounce.leaving, again.leaving))
    diffuse = made.albedo[0, 0].item()
    assert last == pytest.approx(diffuse * (before - once_less), rel=0.05)
    seen = {ratio: glossy(bounce, (0.0, 0.0, -1.0), UP, 0.9, ratio) for ratio in (0.0, 1.0, 1e4)}
    plain = glossy(with_leaving(bounce, bounce.leaving), (0.0, 0.0, -1.0), UP, 0.9, 0.0).complete.sum()
    whole = seen[0.0].complete.sum() - plain
    share = {ratio: (light.complete.sum() - plain) / whole for ratio, light in seen.items()}
    assert 0.2 < share[1.0] < 0.8 and share[1e4] < 0.01
    assert seen[0.0].further.max() == 0
    torch.testing.assert_close(seen[1.0].further, seen[0.0].complete - seen[1.0].complete, rtol=0.3, atol=0)


def glossy(bounce: Radiosity, at, outgoing, roughness: float, diffuse_ratio: float = 1.0, **options) -> GlossyLight:
    """Of one point of the floor, of plastic."""
    gloss = torch.tensor([[roughness], [0.04], [diffuse_ratio]])
    return bounce.glossy(torch.tensor([at]), UP, outgoing, *gloss, torch.tensor([0]), **options)


def test_walls_that_glow_light_each_other_by_the_series_of_bounces():
    scene = closed_box((0.5, 0.5, 0.5))
    walls = ~scene.is_light[:, None] * np.float32((1, 1, 1))
    scene = replace(scene, emission=1e-6 * scene.emission, glow=0.2 * walls)
    side = torch.linspace(-0.6, 0.6, 4)
    points = torch.cat([torch.cartesian_prod(side, side), torch.full((16, 1), -1.0)], 1)
    light = built(scene).diffuse(points, UP.expand(16, 3))
    torch.testing.assert_close(light.fire.mean(0), torch.full((3,), 0.2), rtol=0.05, atol=0)
    torch.testing.assert_close(light.indirect.mean(0), torch.full((3,), 0.2 * 0.5 / (1 - 0.5)), rtol=0.1, atol=0)


def test_without_reflective_caustics_metal_sends_no_light_to_matte_surfaces():
    scene = closed_box((0.8, 0.8, 0.8))
    scene.tiles[scene.tile_index[~scene.is_light], METALLIC] = 1
    points = torch.tensor([[0.3, -0.2, -1.0], [-0.5, 0.6, -1.0]])
    lit, dark = (built(replace(scene, caustics=caustics)).diffuse(points, UP.expand(2, 3)).indirect
                 for caustics in (None, np.array([False, True])))
    assert lit.min() > 0 and dark.max() == 0


def test_passing_a_translucent_sheet_costs_no_diffuse_bounce():
    """One spans a box; light passes it many times between the walls above and below."""
    corners = np.float32([[(-1, -1, -0.5), (1, -1, -0.5), (1, 1, -0.5)], [(-1, -1, -0.5), (1, 1, -0.5), (-1, 1, -0.5)]])
    sheet, under = flat(corners, (0.8, 0.8, 0.8)), torch.tensor([[0.2, 0.1, -0.6], [-0.4, 0.3, -0.6]])
    sheet.translucent = np.ones((len(sheet.tiles), 3), np.float32)
    scene = closed_box((0.5, 0.5, 0.5)).appended(sheet)
    least, most = (built(replace(scene, bounces=np.int32([2, 4, transmission, 12]))).diffuse(under, UP.expand(2, 3))
                   for transmission in (0, 12))
    assert most.indirect.mean() > 1.05 * least.indirect.mean()


def test_a_glossy_surface_shows_more_of_a_bright_wall_from_where_it_is_mirrored():
    bounce = built(walls((0.8, 0.8, 0.8)))
    towards, away = (torch.nn.functional.normalize(torch.tensor([[x, 0.0, 0.5]]), dim=-1) for x in (1.0, -1.0))
    wall, nothing = (glossy(bounce, (0.0, 0.0, 0.0), eye, 0.2).complete[0, 0].item() for eye in (towards, away))
    assert wall > 5 * nothing


def test_of_the_sky_a_rough_surface_misses_what_a_wall_hides_by_how_bright_that_is():
    """The wall stands where the sky is bright, or dark."""
    sky, shares = np.full((8, 16, 3), 0.01, np.float32), []
    sky[:, 4:12] = 1
    for environment in sky, np.roll(sky, 8, axis=1):
        bounce = built(replace(walls((0.8, 0.8, 0.8)), environment=environment))
        shares.append(glossy(bounce, (-0.8, 0.0, 0.0), UP, 0.8).sky.mean().item())
    clear, covered = shares
    assert covered < 0.4 and clear > 0.9


def test_beside_traced_light_a_glossy_surface_shows_what_paths_of_its_lobe_do_not():
    """A lobe alone is traced as a whole; one that few paths are chosen by is not; a mirror is, beside much else."""
    bounce, at = built(walls((0.8, 0.8, 0.8))), (-0.8, 0.0, 0.0)
    found = {ratio: glossy(bounce, at, UP, 0.9, ratio, traced=True) for ratio in (0.0, 1.0, 1e4)}
    every, again = glossy(bounce, at, UP, 0.9).complete, found[0.0].bounced
    missed = {ratio: light.missed / (every - again) for ratio, light in found.items()}
    assert again.max() > 0 and missed[0.0].max() == 0 and missed[1e4].min() > 0.99
    assert 0.3 < missed[1.0].min() and missed[1.0].max() < 0.7
    towards = torch.nn.functional.normalize(torch.tensor([[1.0, 0.0, 0.5]]), dim=-1)
    mirrored = glossy(bounce, (0.0, 0.0, 0.0), towards, 0.1, 10.0, traced=True)
    all_of_it = glossy(bounce, (0.0, 0.0, 0.0), towards, 0.1).complete
    assert mirrored.missed.max() < 0.1 * (all_of_it - mirrored.bounced).min()


def test_a_slanting_lamp_makes_a_polished_floor_shine_more_than_a_steep_one():
    """As much light arrives on a black floor by either."""
    shining = []
    for aside in (0.0, 6.0):
        floor = floor_scene()
        floor.tiles[:, ROUGHNESS], floor.tiles[:, IOR], floor.tiles[:, BASE_COLOR] = 0.3, 1.3291, 0
        floor.triangles[floor.is_light] += np.float32((aside, 0, 0))
        at, layer, full = torch.zeros(1, 3), torch.tensor([[0.04], [0.67]]), Visibility(*torch.ones(2, 1, 3))
        arrived, slanting, _ = DirectLight(floor).diffuse_and_layer(at, UP, full, *layer)
        bounce = built(floor)
        middle = patches_of(floor).center.norm(dim=-1).argmin()
        shining.append(((slanting / arrived).mean().item(), (bounce.leaving[middle] / arrived).mean().item()))
    (steep, by_steep), (slanted, by_slanted) = shining
    assert slanted > 1.8 * steep and by_slanted > 1.8 * by_steep > 0


def test_light_that_is_asked_for_alone_is_the_same():
    bounce = built(replace(walls((0.8, 0.5, 0.2)), environment=np.full((8, 16, 3), 0.5, np.float32)))
    at, row = torch.zeros(3, 3), torch.arange(3)
    up = UP.expand(3, 3)
    light, both = (bounce.diffuse(at, up, row, with_sky=with_sky) for with_sky in (False, True))
    assert torch.equal(light.indirect, both.indirect) and light.sky is None and both.sky is not None
    eye = torch.nn.functional.normalize(torch.ones(1, 3), dim=-1)
    for traced in False, True:
        both, light = (glossy(bounce, (0.0, 0.0, 0.0), eye, 0.3, traced=traced, with_sky=with_sky)
                       for with_sky in (True, False))
        assert both.sky is not None and light.sky is None and torch.equal(light.complete, both.complete)
        for name in ("bounced", "missed"):
            one, other = getattr(light, name), getattr(both, name)
            assert torch.equal(one, other) if traced else one is other is None


def test_rays_into_the_face_that_they_start_from_carry_nothing():
    """Around a shading normal that leans, some would see the light that the face itself sends on."""
    bounce = built(with_black_lamps(floor_scene(side=6)))
    bright = with_leaving(bounce, torch.ones(len(bounce.leaving), 1))
    leaning = torch.tensor([[0.8, 0.0, 0.6]])
    assert bright.diffuse(torch.tensor([[0.1, 0.2, 3e-4]]), leaning).indirect.max() < 1e-6


def test_what_shines_sends_on_the_light_that_falls_on_it():
    """Like any surface of its colour: a plate beneath a lamp, whose own light is no indirect one."""
    def gathered(color, radiance: float) -> torch.Tensor:
        plate = roof(color)
        plate.emission[:] = radiance
        return arriving(built(floor_scene().appended(plate)), [[0.0, 0.0, 0.6]], -UP)

    grey, shining, black = gathered((0.6, 0.6, 0.6), 0), gathered((0.6, 0.6, 0.6), 1e-3), gathered((0, 0, 0), 1e-3)
    assert grey.min() > 0.03
    torch.testing.assert_close(shining, grey, rtol=0.05, atol=0)
    assert black.max() < 0.3 * grey.min()
