# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounced light in closed form: what is known about it without a renderer."""
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import area_vectors
from renderformer_v2.model.light.bounce import patches, probes
from renderformer_v2.model.light.bounce.openness import Openness
from renderformer_v2.model.light.bounce.panes import PASSED
from renderformer_v2.model.light.bounce.probes import Probes
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight, Lamps
from renderformer_v2.model.material.reflectance import BLURRED, layer_reflectance
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, RenderScene, constant_tile
from tests.model.no_host_copies import NoHostCopies
from tests.model.samples import flat, floor_scene, walls

MANY = 50  # times the rays of a point
RATIO = 0.5 / 0.3  # of half the side of `roof` to its height
COVERED = 4 / (2 * np.pi) * 2 * RATIO / np.sqrt(1 + RATIO**2) * np.arctan(RATIO / np.sqrt(1 + RATIO**2))  # by it
NO_LAMPS = Lamps(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
UP = torch.tensor([[0.0, 0.0, 1.0]])


def built(scene: RenderScene) -> Radiosity:
    return Radiosity(scene, DirectLight(scene))


def parts(bounce: Radiosity, points, normals) -> tuple[torch.Tensor, torch.Tensor]:
    """(P, 3) all and that which has bounced before, without the noise of a point's few rays."""
    points, normals = torch.as_tensor(points), torch.as_tensor(normals).expand(len(points), 3)
    found = bounce(points.repeat(MANY, 1), normals.repeat(MANY, 1))[:, :6]
    return found.view(MANY, -1, 6).mean(0).split(3, dim=-1)


def arriving(bounce: Radiosity, points, normals) -> torch.Tensor:
    return parts(bounce, points, normals)[0]


def test_bounces_between_patches_never_wait_for_a_card(monkeypatch):
    calls = []

    def watched(self, *given, real=Radiosity._bounced):
        with NoHostCopies():
            calls.append(real(self, *given))
        return calls[-1]

    monkeypatch.setattr(Radiosity, "_bounced", watched)
    built(walls((0.9, 0.1, 0.1)))
    assert len(calls) == 1 and all(light.max() > 0 for light in calls[0])


def test_a_point_that_faces_a_bright_plane_gathers_its_radiance():
    bounce = built(floor_scene(side=2))
    bounce.leaving = torch.ones_like(bounce.leaving)
    near, far = (arriving(bounce, [[0.05, 0.03, z]], -UP)[0, 0].item() for z in (0.2, 3.0))
    # A square of side 2 at distance z: its form factor by the formula for parallel differential areas.
    for z, found, error in ((0.2, near, 0.02), (3.0, far, 0.1)):
        x = 1 / z
        expected = 4 / (2 * np.pi) * 2 * x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x))
        assert found == pytest.approx(expected, rel=error)
    assert built(floor_scene())(torch.tensor([[0.0, 0.0, 0.5]]), UP)[:, :6].abs().max() == 0  # the lamp alone


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
    bounce.leaving = torch.ones_like(bounce.leaving)
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 2 - 1
    normals = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    for light in parts(bounce, points, normals):  # of a few aimed rays, too many may meet what they aim at
        assert light.max() <= 1.03


def test_merged_patches_give_nearly_the_same_light(monkeypatch):
    """Coarse walls beside a thin plate of many small triangles that face up and down."""
    fine = floor_scene(side=24).triangles[:-1] * 0.3 + np.float32((0.5, 0, 0.5))
    plate = flat(np.concatenate([fine, fine[:, ::-1] - np.float32((0, 0, 0.01))]), (0.2, 0.6, 0.8))
    scene = walls((0.8, 0.05, 0.05)).appended(plate)
    points = torch.tensor([[0.3, 0.2, 0.0], [-0.5, 0.5, 0.0], [0.8, -0.6, 0.0]])
    exact = arriving(built(scene), points, UP)
    monkeypatch.setattr(patches, "PATCHES", 512)
    few = built(scene)
    assert 256 < len(few.interior.normal) <= 512 < len(scene)
    torch.testing.assert_close(arriving(few, points, UP), exact, rtol=0.1, atol=1e-3)


def test_patches_of_the_rest_stay_when_something_moves(monkeypatch):
    """However many triangles come and go: light would flicker."""
    monkeypatch.setattr(patches, "PATCHES", 512)
    fine = floor_scene(side=24).triangles[:-1] * 0.1 + np.float32((0.5, 0, 0.3))
    found = []
    for plate in fine, fine[7:] + np.float32((0.01, 0, 0.02)):
        made = patches.patches(walls((0.8, 0.05, 0.05)).appended(flat(plate, (0, 0, 0))), NO_LAMPS)
        found.append(made.center[made.albedo[:, 0] > 0.5])
    assert 100 < len(found[0]) and torch.equal(*found)


@pytest.mark.parametrize("side", [2, 40])
def test_a_ground_to_the_horizon_lights_what_stands_on_it_as_an_endless_one(side):
    """Coarse, so that it is split, and fine, so that it is merged: a wall sees it in half of its hemisphere."""
    ground = floor_scene(side).triangles[:-1] * np.float32((2000, 2000, 0)) - np.float32((0, 0, 0.2))
    bounce = built(flat(ground, (0.5, 0.5, 0.5)))
    bounce.leaving = torch.ones_like(bounce.leaving)
    wall = torch.tensor([[0.0, -1.0, 0.0]])
    for height in (-0.1, 0.0, 0.3):
        assert arriving(bounce, [[0.1, 0.2, height]], wall)[0, 0].item() == pytest.approx(0.5, abs=0.06)


def roof(color, **material) -> RenderScene:
    """A plate above the floor's middle."""
    corners = np.float32([[[-1, -1, 0], [1, 1, 0], [1, -1, 0]], [[-1, -1, 0], [-1, 1, 0], [1, 1, 0]]])
    return replace(flat(corners * 0.5 + np.float32((0, 0, 0.3)), color), tiles=constant_tile(color, **material)[None])


def patches_of(scene: RenderScene) -> patches.Patches:
    """Those of its radiosity."""
    prior = DirectLight(scene)
    openness = Openness(prior.blocking, prior.blockers, torch.device("cpu"))
    return patches.patches(scene, prior.lamps(), openness=openness)


def test_what_stands_in_between_keeps_light_away():
    """A black plate between the floor's middle and a bright ceiling."""
    ceiling = flat(floor_scene(side=6).triangles[:-1] * np.float32((1, 1, 0)) + np.float32((0, 0, 0.55)), (0.8,) * 3)
    light = []
    for scene in (ceiling, ceiling.appended(roof((0.0, 0.0, 0.0)))):
        bounce = built(scene)
        bright = patches_of(scene).center[:, 2] > 0.5
        bounce.leaving = bright.float().repeat(2)[:, None].expand(-1, 6)
        light.append(arriving(bounce, [[0.0, 0.0, 0.0], [0.0, 0.0, 0.45]], UP)[:, 0])
    assert light[1][0] < 0.4 * light[0][0] and light[1][1] > 0.9


@pytest.mark.parametrize("material, share", [
    ({"transmission": 1.0}, 1.0), ({"transmission": 0.75}, 0.75), ({"transmission": 1.0, "metallic": 0.8}, 0.0)])
def test_a_wall_behind_glass_is_dimmed_by_what_passes_and_one_behind_metal_is_not_seen(material, share):
    """By one surface, of which the colour's root. Metallic weighs more than transmission, as in Principled BSDF."""
    above = floor_scene(side=6).triangles[:-1] * np.float32((1, 1, 0)) + np.float32((0, 0, 0.55))
    scene = flat(above, (0.8,) * 3).appended(roof((0.8,) * 3, ior=1.5, **material))
    bounce = built(scene)
    bright = patches_of(scene).center[:, 2] > 0.5
    bounce.leaving = bright.float().repeat(2)[:, None].expand(-1, 6)
    found = arriving(bounce, [[0.0, 0.0, 0.29]], UP)[0, 0].item()
    assert found == pytest.approx(share * PASSED * 0.8 ** 0.5, abs=0.05)


@pytest.mark.parametrize("ior, share", [(1.5, PASSED * 0.8 ** 0.5), (1.0, 0.0)])
def test_sky_seen_through_coloured_glass_lights_what_is_behind_and_through_holes_it_does_already(ior, share):
    """One surface of glass is passed; an ior of 1 lets light pass straight, which the light prior knows."""
    scene = roof((0.8, 0.8, 0.8), transmission=1.0, ior=ior, roughness=0.0)
    scene.environment = np.full((256, 512, 3), 2.0, np.float32)
    bounce, prior = built(scene), DirectLight(scene)
    found = arriving(bounce, [[0.0, 0.0, 0.0]], UP)[0, 0].item()
    assert found == pytest.approx(2 * share * COVERED, abs=0.12)
    assert prior.arriving(torch.zeros(1, 3), UP)[0, 0].item() == pytest.approx(1 if ior == 1 else 1 - COVERED, abs=0.12)


def test_pixels_between_probes_get_smooth_light_and_edges_stay(monkeypatch):
    """Left half a floor, right half a wall far behind: no light runs from one to the other."""
    position = torch.zeros(16, 32, 3)
    position[..., 0] = torch.linspace(-1, 1, 32)
    position[:, 16:, 2] = 5.0
    normal = UP.expand(16, 32, 3)
    covered = torch.ones(16, 32, 1, dtype=torch.bool)
    covered[:3] = False
    light = Probes(position, normal, covered).gathered(lambda x, n, _: (x[:, 2:] > 1).float().expand(-1, 3) + 1)
    assert light[:3].abs().max() == 0
    torch.testing.assert_close(light[3:, :16], torch.ones(13, 16, 3))
    torch.testing.assert_close(light[3:, 16:], torch.full((13, 16, 3), 2.0))
    flat_x = position * torch.tensor([1.0, 1, 0])
    ramp = Probes(flat_x, normal, covered | True).gathered(lambda x, n, _: x[:, :1].expand(-1, 3))
    inner = slice(probes.GRID, -probes.GRID)
    torch.testing.assert_close(ramp[:, inner, 0], position[:, inner, 0], atol=1e-5, rtol=0)


def test_a_scene_of_lights_alone_gathers_nothing():
    scene = floor_scene()
    lights = scene.is_light
    alone = replace(scene, **{name: getattr(scene, name)[lights] for name in
                              ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")})
    radiosity = Radiosity(alone, DirectLight(alone))
    points = torch.zeros(3, 3)
    assert (radiosity(points, torch.eye(3))[:, :6] == 0).all() and radiosity(points[:0], points[:0]).shape == (0, 9)


def closed_box(color) -> RenderScene:
    """Two units wide, with a lamp in its middle."""
    square = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
    sides = [np.roll(square + np.float32((0, 0, z)), axis, axis=-1) for axis in range(3) for z in (-1, 1)]
    scene = floor_scene()
    lamp = scene.triangles[scene.is_light]
    scene.triangles[scene.is_light] = lamp - lamp.mean(axis=(0, 1)) + np.float32((0.3, 0.2, 0.1))
    lights = {name: getattr(scene, name)[scene.is_light] for name in
              ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")}
    return flat(np.concatenate(sides), color).appended(replace(scene, **lights))


def test_no_patch_is_on_both_sides_of_a_wall():
    """A floor that reaches from a closed box to the outside, under its walls."""
    box = closed_box((0.5, 0.5, 0.5))
    inner, outer = box.triangles * np.float32((0.5, 0.5, 0.4)), box.triangles[:, ::-1] * np.float32((0.6, 0.6, 0.5))
    floor = floor_scene(side=1).triangles[:-1] * np.float32((2, 2, 0)) - np.float32((0, 0, 0.3))
    scene = flat(np.concatenate([inner, outer, floor]), (0.5, 0.5, 0.5))
    scene.environment = np.full((8, 16, 3), 1.0, np.float32)
    made = patches_of(scene)
    on_floor = made.corners[:, :, 2].sub(-0.3).abs().amax(1) < 1e-4
    reach = made.corners[on_floor][:, :, :2].abs().amax(2)  # of the corners, from the middle
    inside = torch.zeros(len(made.center)).index_add(0, made.patch[on_floor], (reach.amin(1) < 0.45).float())
    outside = torch.zeros(len(made.center)).index_add(0, made.patch[on_floor], (reach.amax(1) > 0.65).float())
    assert (inside > 0).sum() > 20 and (outside > 0).sum() > 20 and not ((inside > 0) & (outside > 0)).any()


def test_what_stands_on_a_floor_is_no_patch_with_the_underside_of_that():
    plate = closed_box((0.5, 0.5, 0.5)).triangles[:, ::-1]
    floor, block = plate * np.float32((1, 1, 0.02)), plate * np.float32((0.2, 0.2, 0.1)) + np.float32((0, 0, 0.12))
    made = patches_of(flat(np.concatenate([floor, block]), (0.5, 0.5, 0.5)))
    for row in range(len(made.center)):
        heights = made.corners[made.patch == row][..., 2]
        assert not len(heights) or not ((heights < -0.01).any() and (heights > 0.01).any() and (
            made.vector[row, 2].abs() > 0.9 * made.vector[row].norm()))


def test_a_small_bright_surface_lights_evenly_because_rays_aim_at_it():
    """A ten-thousandth of the hemisphere, which one of a hundred points would see by rays all around."""
    wall = floor_scene(side=8).triangles[:-1] * np.float32((1, 1, 0))
    bright = floor_scene(side=1).triangles[:-1] * np.float32((0.01, 0.01, 0)) + np.float32((0, 0, 0.5))
    bounce = built(flat(np.concatenate([wall, bright]), (0.5, 0.5, 0.5)))
    shines = bounce.interior.normal.new_zeros(2 * len(bounce.interior.normal))
    corners = bounce.interior.corners
    rows = bounce.interior.patch[:len(corners)][corners[..., 2].amin(1) > 0.4]
    shines[rows] = shines[rows + len(shines) // 2] = 1.0
    bounce.leaving = shines[:, None].expand(-1, 6)
    at = torch.rand(512, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([0.02, 0.02, 0])
    by_chance = bounce(at, UP.expand(512, 3))[:, 0]
    bounce.interior.aim(shines)
    aimed = bounce(at, UP.expand(512, 3))[:, 0]
    expected = np.linalg.norm(area_vectors(bright), axis=-1).sum() / (math.pi * 0.5 ** 2)
    assert aimed.mean().item() == pytest.approx(expected, rel=0.1)
    assert aimed.std() < 0.1 * expected < by_chance.std()


def test_patches_are_small_where_a_lamp_is_near():
    scene = closed_box((0.5, 0.5, 0.5))
    lamp = np.float32([[0.0, 0.0, -0.9]])
    made = patches.patches(scene, Lamps(lamp, np.ones(1, np.float32)))
    on_floor = made.center[:, 2] < -0.99
    near = (made.center[:, :2].norm(dim=-1) < 0.2) & on_floor
    far = (made.center[:, :2].norm(dim=-1) > 0.9) & on_floor
    assert near.sum() > 10 and 20 * made.vector[near].norm(dim=-1).mean() < made.vector[far].norm(dim=-1).mean()


def test_of_parts_as_large_as_each_other_a_patch_stands_on_the_first():
    """Not on whichever thread was last: pictures would differ from run to run."""
    count = 1000
    center = torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) * 1e-3 + 1e-3
    vector, no_lamps = torch.tensor([[0.0, 0.0, 1e-6]]).repeat(count, 1), Lamps(np.zeros((0, 3)), np.zeros(0))
    alike = torch.zeros(count, dtype=torch.long)
    middle, *_ = patches._merged(center, vector, torch.ones(count, 9), alike, alike, no_lamps, 1)
    torch.testing.assert_close(middle, center[:1], rtol=0, atol=0)


def test_the_points_of_patches_lie_on_them():
    scene = closed_box((0.5, 0.5, 0.5))
    made = patches.patches(scene, DirectLight(scene).lamps())
    points, normals = made.points(4)
    assert points.shape == normals.shape == (len(made.center), 4, 3)
    torch.testing.assert_close(points.abs().amax(-1), torch.ones(points.shape[:2]), atol=1e-5, rtol=0)
    away, size = (points - made.center[:, None]).norm(dim=-1), made.vector.norm(dim=-1).sqrt()
    assert (away <= 2 * size[:, None]).all() and (away.amax(1) > 0.1 * size).all()
    assert ((normals * made.vector[:, None]).sum(-1) > 0).all()


def test_all_light_of_a_lamp_arrives_in_a_closed_box():
    scene = closed_box((0.5, 0.5, 0.5))
    scene.tiles[:, IOR] = 1
    prior = DirectLight(scene)
    bounce, made = Radiosity(scene, prior), patches.patches(scene, prior.lamps())
    area = made.vector.norm(dim=-1)[:, None]
    first = bounce.leaving[:, :3] - bounce.leaving[:, 3:]
    arrived = sum((area * side / 0.5).sum(0) for side in first.split(len(area)))
    sheets = 2 * np.linalg.norm(area_vectors(prior.corners.numpy()), axis=-1)
    emitted = torch.from_numpy(np.float32(sheets)) @ prior.radiance[:len(sheets)]  # by both sides, over pi
    emitted = emitted + 4 * np.pi * prior.radii.square() @ prior.radiance[len(sheets):]
    torch.testing.assert_close(arrived, emitted, rtol=0.05, atol=0)


def test_light_between_white_walls_adds_up_as_the_series_of_its_bounces():
    """In a closed box nearly all of it is the same everywhere: four diffuse bounces, and glossy ones between them."""
    scene = closed_box((0.8, 0.8, 0.8))
    scene.tiles[:, ROUGHNESS] = 0.9
    prior = DirectLight(scene)
    bounce, made = Radiosity(scene, prior), patches.patches(scene, prior.lamps())
    diffuse, _, glossy = made.albedo[0].view(3, 3)[:, 0].tolist()
    area = made.vector.norm(dim=-1)[:, None]
    every, again = ((area.repeat(2, 1) * light).sum().item() for light in bounce.leaving.split(3, dim=1))
    series = sum(math.comb(d + g, g) * diffuse ** d * glossy ** g for d in range(4) for g in range(3))
    assert again / (every - again) == pytest.approx(series - 1, rel=0.05)


def glossy(bounce: Radiosity, at, outgoing, roughness: float, matte: float = 1.0, **options) -> torch.Tensor:
    """Of one point of the floor, of plastic."""
    gloss = torch.tensor([[roughness, 0.04, matte]])
    return bounce.glossy(torch.tensor([at]), UP, outgoing, gloss, torch.tensor([0]), **options)[0]


def test_a_glossy_surface_shows_more_of_a_bright_wall_from_where_it_is_mirrored():
    bounce = built(walls((0.8, 0.8, 0.8)))
    towards, away = (torch.nn.functional.normalize(torch.tensor([[x, 0.0, 0.5]]), dim=-1) for x in (1.0, -1.0))
    wall, nothing = (glossy(bounce, (0.0, 0.0, 0.0), eye, 0.2)[0].item() for eye in (towards, away))
    assert wall > 5 * nothing


def test_of_the_sky_a_rough_surface_misses_what_a_wall_hides_by_how_bright_that_is():
    """The wall stands where the sky is bright, or dark."""
    sky, shares = np.full((8, 16, 3), 0.01, np.float32), []
    sky[:, 4:12] = 1
    for environment in sky, np.roll(sky, 8, axis=1):
        bounce = built(replace(walls((0.8, 0.8, 0.8)), environment=environment))
        shares.append(glossy(bounce, (-0.8, 0.0, 0.0), UP, 0.8)[3:].mean().item())
    clear, covered = shares
    assert covered < 0.4 and clear > 0.9


def test_beside_traced_light_a_glossy_surface_shows_what_paths_of_its_lobe_do_not():
    """A lobe alone is traced as a whole; one that few paths are chosen by is not; a mirror is, beside much else."""
    bounce, at = built(walls((0.8, 0.8, 0.8))), (-0.8, 0.0, 0.0)
    found = {matte: glossy(bounce, at, UP, 0.9, matte, traced=True, direct=False) for matte in (0.0, 1.0, 1e4)}
    every, again = glossy(bounce, at, UP, 0.9, direct=False), found[0.0][:3]
    missed = {matte: light[3:] / (every - again) for matte, light in found.items()}
    assert again.max() > 0 and missed[0.0].max() == 0 and missed[1e4].min() > 0.99
    assert 0.3 < missed[1.0].min() and missed[1.0].max() < 0.7
    towards = torch.nn.functional.normalize(torch.tensor([[1.0, 0.0, 0.5]]), dim=-1)
    mirrored = glossy(bounce, (0.0, 0.0, 0.0), towards, 0.1, 10.0, traced=True, direct=False)
    all_of_it = glossy(bounce, (0.0, 0.0, 0.0), towards, 0.1, direct=False)
    assert mirrored[3:].max() < 0.1 * (all_of_it - mirrored[:3]).min()


def test_a_smooth_layer_takes_its_own_share_of_the_diffuse_light_and_sends_on_as_much_as_a_blurred_one():
    """Cycles blurs glossy surfaces that matte ones see, and a rougher layer reflects less at a slant."""
    scene = floor_scene()
    scene.tiles[:, ROUGHNESS], scene.tiles[:, IOR], scene.tiles[:, BASE_COLOR] = 0.2, 1.3291, 0.5
    diffuse, metal, glossy = patches_of(scene).albedo[0].view(3, 3)[:, 0].tolist()
    own, of_blurred = (layer_reflectance(np.float32(1.3291), np.float32(x)) for x in (0.2, BLURRED ** 0.5))
    assert diffuse == pytest.approx(0.5 * (1 - own), rel=1e-3) and glossy == pytest.approx(of_blurred, rel=1e-3)
    assert of_blurred < 0.7 * own and metal == 0


def test_a_slanting_lamp_makes_a_polished_floor_shine_more_than_a_steep_one():
    """As much light arrives on a black floor by either."""
    shining = []
    for aside in (0.0, 6.0):
        floor = floor_scene()
        floor.tiles[:, ROUGHNESS], floor.tiles[:, IOR], floor.tiles[:, BASE_COLOR] = 0.3, 1.3291, 0
        floor.triangles[floor.is_light] += np.float32((aside, 0, 0))
        prior, at, gloss = DirectLight(floor), torch.zeros(1, 3), torch.tensor([[0.04], [0.67]])
        arrived, slanting = prior.diffuse(at, UP, torch.ones(1, 6), *gloss)[0].split(3)
        bounce = built(floor)
        middle = patches_of(floor).center.norm(dim=-1).argmin()
        shining.append(((slanting / arrived).mean().item(), (bounce.leaving[middle, :3] / arrived).mean().item()))
    (steep, by_steep), (slanted, by_slanted) = shining
    assert slanted > 1.8 * steep and by_slanted > 1.8 * by_steep > 0


def test_light_that_is_asked_for_alone_is_the_same():
    bounce = built(replace(walls((0.8, 0.5, 0.2)), environment=np.full((8, 16, 3), 0.5, np.float32)))
    at, row = torch.zeros(3, 3), torch.arange(3)
    up = UP.expand(3, 3)
    assert torch.equal(bounce(at, up, row, alone=True), bounce(at, up, row)[:, :3])
    eye = torch.nn.functional.normalize(torch.ones(1, 3), dim=-1)
    for traced in False, True:
        whole, lit = (glossy(bounce, (0.0, 0.0, 0.0), eye, 0.3, traced=traced, direct=both) for both in (True, False))
        assert torch.equal(lit, whole[:-3])
