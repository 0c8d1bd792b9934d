# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches: where they are, how large, and what they reflect."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce import patches
from renderformer_v2.model.light.bounce.openness import Openness
from renderformer_v2.model.light.bounce.patches import Patches, make_patches
from renderformer_v2.model.light.bounce.subdivision import Subdivision
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.emitter_light import NearEmitters
from renderformer_v2.model.light.fresnel import layer_albedo
from renderformer_v2.model.material.reflectance import BLURRED
from renderformer_v2.model.scene import BASE_COLOR, IOR, ROUGHNESS, TILE_SIZE, TRANSMISSION, RenderScene
from tests.model.samples import closed_box, flat, floor_scene, walls, with_black_lamps

NO_EMITTERS = NearEmitters(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))


def patches_of(scene: RenderScene) -> Patches:
    """The patches of the scene's radiosity."""
    direct = DirectLight(scene)
    openness = Openness(scene, direct.occluders, torch.device("cpu"))
    return make_patches(scene, direct.emitters.near(), openness=openness)


def test_patches_of_the_rest_stay_when_something_moves(monkeypatch):
    """However many triangles come and go: light would flicker."""
    monkeypatch.setattr(patches, "PATCHES", 512)
    fine = floor_scene(side=24).triangles[:-1] * 0.1 + np.float32((0.5, 0, 0.3))
    found = []
    for plate in fine, fine[7:] + np.float32((0.01, 0, 0.02)):
        made = make_patches(walls((0.8, 0.05, 0.05)).appended(flat(plate, (0, 0, 0))), NO_EMITTERS)
        found.append(made.center[made.albedo[:, 0] > 0.5])
    assert 100 < len(found[0]) and torch.equal(*found)


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


def test_patches_are_small_where_a_lamp_is_near():
    scene = closed_box((0.5, 0.5, 0.5))
    lamp = np.float32([[0.0, 0.0, -0.9]])
    made = make_patches(scene, NearEmitters(lamp, np.ones(1, np.float32)))
    on_floor = made.center[:, 2] < -0.99
    near = (made.center[:, :2].norm(dim=-1) < 0.2) & on_floor
    far = (made.center[:, :2].norm(dim=-1) > 0.9) & on_floor
    assert near.sum() > 10 and 20 * made.vector[near].norm(dim=-1).mean() < made.vector[far].norm(dim=-1).mean()


def test_of_parts_as_large_as_each_other_a_patch_stands_on_the_first():
    """Not on whichever thread was last: pictures would differ from run to run."""
    count = 1000
    center = torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) * 1e-3 + 1e-3
    vector = torch.tensor([[0.0, 0.0, 1e-6]]).repeat(count, 1)
    alike = torch.zeros(count, dtype=torch.long)
    middle, *_ = patches._merge(center, vector, torch.ones(count, 9), alike, alike, alike, alike, NO_EMITTERS, 1)
    torch.testing.assert_close(middle, center[:1], rtol=0, atol=0)


def test_a_smooth_layer_takes_its_own_share_of_the_diffuse_light_and_sends_on_as_much_as_a_blurred_one():
    """Cycles blurs glossy surfaces that matte ones see, and a rougher layer reflects less at a slant."""
    scene = floor_scene()
    scene.tiles[:, ROUGHNESS], scene.tiles[:, IOR], scene.tiles[:, BASE_COLOR] = 0.2, 1.3291, 0.5
    diffuse, metal, glossy = patches_of(scene).albedo[0].view(3, 3)[:, 0].tolist()
    layer = torch.tensor([0.04]), torch.tensor([0.2])
    own, of_blurred = layer_albedo(*layer).item(), layer_albedo(*layer, torch.tensor([BLURRED ** 0.5])).item()
    assert diffuse == pytest.approx(0.5 * (1 - own), rel=2e-3) and glossy == pytest.approx(of_blurred, rel=2e-3)
    assert of_blurred < 0.7 * own and metal == 0


def test_long_triangles_are_divided_sooner_than_others_of_their_area():
    regular = np.float32([[(0, 0, 0), (1, 0, 0), (0.5, 0.75 ** 0.5, 0)]])
    long = np.float32([[(0, 0, 0), (10, 0, 0), (5, 0.1 * 0.75 ** 0.5, 0)]])
    sizes = [patches._apparent_size(0.01 * x, NO_EMITTERS, np.zeros(1, bool))[0] for x in (regular, long)]
    assert sizes[1] == pytest.approx(100 ** 0.25 * sizes[0], rel=0.01)
    assert patches._apparent_size(np.zeros((1, 3, 3), np.float32), NO_EMITTERS, np.zeros(1, bool))[0] == 0


def test_slices_of_needles_beside_a_fine_mesh_are_not_quartered_for_lack_of_room():
    """Each of its triangles is a piece, however small."""
    needle, small = np.float32([(0, 0, 0), (1, 0, 0), (1, 0.1, 0)]), np.float32([(0, 0, 0), (1e-3, 0, 0), (0, 1e-3, 0)])
    shapes = [needle] * 10 + [small] * 70
    triangles = np.stack([shape + np.float32((-0.5, 0.01 * i, 0)) for i, shape in enumerate(shapes)])
    made = Subdivision(triangles, np.arange(80))
    patches._split(made, NO_EMITTERS, np.zeros(80, bool), 80)
    assert 120 < len(made.corners) < 200


def test_patches_have_the_colour_of_their_triangles_and_not_of_what_lies_beyond_these():
    scene, row = with_black_lamps(floor_scene()), np.arange(TILE_SIZE)
    whole = patches_of(scene).albedo
    scene.tiles[:, BASE_COLOR, np.add.outer(row, row) >= TILE_SIZE] = 0
    torch.testing.assert_close(patches_of(scene).albedo, whole, atol=2e-4, rtol=0)


def test_holes_leave_the_patches_of_what_is_there_as_they_are():
    scene = with_black_lamps(floor_scene())
    whole, row = patches_of(scene), np.arange(TILE_SIZE)
    is_hole = np.add.outer(row, row) % 2 == 1
    for channel, value in ((BASE_COLOR, 1), (TRANSMISSION, 1), (IOR, 1), (ROUGHNESS, 0)):
        scene.tiles[:, channel, is_hole] = value
    in_triangle = is_hole[np.add.outer(row, row) < TILE_SIZE]
    scene.clear = np.full((len(scene.tiles), 3), in_triangle.mean(), np.float32)
    cut = patches_of(scene)
    torch.testing.assert_close(cut.albedo, whole.albedo, atol=1e-3, rtol=0)
    torch.testing.assert_close(cut.layer, whole.layer, atol=2e-3, rtol=0)
