# SPDX-License-Identifier: GPL-3.0-or-later
"""The light that is estimated at the first hits of a view."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.fields import layouts
from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.light import estimate
from renderformer_v2.model.light.effort import FULL
from renderformer_v2.model.light.estimate import estimate_light
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE, ROUGHNESS
from tests.model.samples import flat, floor_scene, floor_view, scene_light, walls, with_black_lamps


def test_light_has_the_shapes_that_it_says_and_traced_light_is_passed_on():
    view, guides = floor_view(64, 32)
    guides = replace(guides, traced=guides.diffuse_color - np.float32(0.3))
    light = estimate_light(scene_light(floor_scene()), view, guides)
    sizes = {"V": 1, "H": 32, "W": 64}
    for name, layout in layouts(SurfaceLight).items():
        assert getattr(light, name).shape == tuple(sizes.get(size, size) for size in layout.shape), name
    assert light.is_traced.tolist() == [1]
    np.testing.assert_array_equal(light.traced[0].permute(1, 2, 0), guides.traced.clip(0))  # denoised: below 0 at times


def test_light_behind_a_surface_is_gathered_where_it_lets_light_through():
    light, (view, guides) = scene_light(floor_scene()), floor_view()
    assert not estimate_light(light, view, guides).behind.any()
    guides.transmission_color = guides.diffuse_color
    guides.position = guides.position + np.float32((0, 0, 0.5)) * (guides.alpha[..., None] > 0)  # glass above the floor
    found = estimate_light(light, view, guides)
    assert found.behind[0, :, 32, 32].min() > 0.009 > 10 * found.bounced[0, :, 32, 32].max()


def test_what_a_translucent_sheet_lets_straight_through_is_not_light_of_its_back():
    scene, (view, guides) = floor_scene(), floor_view()
    scene.translucent = np.full((len(scene.tiles), 3), 0.5, np.float32)
    guides.position = guides.position + np.float32((0, 0, 0.5)) * (guides.alpha[..., None] > 0)
    guides.transmission_color, guides.straight = guides.diffuse_color, guides.alpha > 0
    found = estimate_light(scene_light(scene), view, guides)
    assert found.bounced[0, :, 32, 32].min() > 0.001 and not found.behind.any()  # the floor lights it from below


def test_glass_smooth_or_rough_shows_lamps_and_sky_where_its_paths_end():
    scene, (view, guides) = floor_scene(), floor_view()
    guides.transmission_color = guides.diffuse_color
    light, is_covered = scene_light(scene), torch.from_numpy(guides.alpha > 0)
    straight = estimate_light(light, view, guides)
    guides.refracted_light = np.full_like(guides.position, 2.0)
    guides.refracted_position = guides.refracted_normal = guides.refracted_color = np.zeros_like(guides.position)
    for roughness in (0.0, 1.0):
        scene.tiles[:, ROUGHNESS] = roughness
        found = estimate_light(light, view, guides)
        assert found.direct[0, 2][:, is_covered].numpy() == pytest.approx(2, rel=1e-5)
        assert not torch.equal(found.direct[0, 2], straight.direct[0, 2])


def test_a_rough_surface_shows_no_image_but_the_mean_of_light_that_has_bounced_before():
    scene, (view, guides) = walls((0.8, 0.8, 0.8)), floor_view()
    ends = {"reflected_position": guides.position, "reflected_normal": guides.normal,
            "reflected_color": np.full_like(guides.position, 0.5), "traced": np.zeros_like(guides.position),
            "diffuse_color": np.zeros_like(guides.position)}  # of metal, whose first bounce is traced
    light, is_covered, reflections = scene_light(scene), torch.from_numpy(guides.alpha > 0), []
    for roughness in (0.1, 0.9):
        scene.tiles[:, ROUGHNESS] = roughness
        found = estimate_light(light, view, replace(guides, **ends))
        reflections.append(found.reflected[0][:, is_covered])
    image = 0.5 * found.bounced[0][:, is_covered]
    torch.testing.assert_close(reflections[0], image, rtol=0.02, atol=1e-4)  # rays from first hits start off them
    assert 0 < reflections[1].mean() < 0.5 * image.mean()


def test_a_black_object_in_a_lit_room_is_exactly_black():
    view, guides = floor_view()
    for name in ("diffuse_color", "glossy_color", "transmission_color"):
        getattr(guides, name)[:, :32] = 0
    radiance = estimate_light(scene_light(walls((0.8, 0.3, 0.3))), view, guides).radiance()
    assert not radiance[..., :32].any() and radiance[..., 32, 40:48].min() > 0


def divide(monkeypatch, rows: int) -> None:
    """Into bands of so many rows."""
    monkeypatch.setattr(estimate, "BAND_PIXELS", 1)
    monkeypatch.setattr(estimate, "BAND_ROWS", rows)


def test_bands_of_a_large_picture_change_nothing(monkeypatch):
    light, (view, guides) = scene_light(with_black_lamps(floor_scene())), floor_view(128, 64)
    whole = estimate_light(light, view, guides)
    divide(monkeypatch, 24)
    bands = estimate_light(light, view, guides)
    for name in vars(whole):
        torch.testing.assert_close(getattr(bands, name), getattr(whole, name))


@pytest.mark.parametrize("rows", [16, 32])
def test_a_shadow_has_no_seam_where_bands_meet(monkeypatch, rows):
    """Of a board close above the far half of the floor."""
    scene, view = floor_scene(side=6), floor_view()[0]
    board = scene.triangles[~scene.is_light] * np.float32((1, 0.5, 1)) + np.float32((0, 0.5, 0.1))
    light = scene_light(scene.appended(flat(board, (0.5, 0.5, 0.5))))
    guides = cast_guides(light.scene, view)
    whole = estimate_light(light, view, guides).direct
    divide(monkeypatch, rows)
    torch.testing.assert_close(estimate_light(light, view, guides).direct, whole, rtol=0, atol=1e-4 * whole.max())


@pytest.mark.parametrize(("path", "shown"), [("reflected", "reflected"), ("refracted", "direct")])
def test_what_mirrors_and_glass_blur_has_no_seam_where_bands_meet(monkeypatch, path, shown):
    """Lamps at the ends of paths of some rows alone, 1.5 network units off."""
    scene, (view, guides) = floor_scene(), floor_view(64, 96)
    scene.tiles[:, ROUGHNESS] = 0.3
    guides.glossy_color, guides.transmission_color = 0.5 * guides.diffuse_color, 0.5 * guides.diffuse_color
    light, up = np.zeros_like(guides.position), np.float32((0, 0, 1))
    light[40:48] = 2.0
    for name, value in (("light", light), ("position", guides.position + 1.5 * up), ("normal", light * 0 - up),
                        ("color", light * 0 + 0.1)):
        setattr(guides, f"{path}_{name}", value)
    of_scene = scene_light(scene)
    whole = getattr(estimate_light(of_scene, view, guides), shown)
    divide(monkeypatch, 16)
    bands = getattr(estimate_light(of_scene, view, guides), shown)
    torch.testing.assert_close(bands, whole, rtol=0, atol=0.01 * whole.max())


@pytest.mark.parametrize("lobe", ["mirrored", "layer"])
def test_a_mirror_shows_the_highlight_of_what_it_shows(lobe):
    """As if what the camera sees were a mirror, which shows metal, or a layer, below the lamp."""
    scene, (view, guides) = floor_scene(), floor_view()
    scene.tiles[:, ROUGHNESS] = 0.02
    shape = guides.position.shape
    up = np.broadcast_to(np.float16((0, 0, 1)), shape)
    metal = {f"{lobe}_position": np.zeros(shape, np.float32), f"{lobe}_color": np.full(shape, 0.5, np.float16),
             f"{lobe}_roughness": np.full((*shape[:2], 1), 0.3, np.float16),
             "layer_f0": np.full((*shape[:2], 1), 0.04, np.float16),
             "reflected_position": guides.position, "reflected_normal": up,
             "reflected_color": np.zeros(shape, np.float16), "reflected_light": np.zeros(shape, np.float32)}
    light = scene_light(scene)
    dark, lit = (estimate_light(light, view, replace(guides, **{f"{lobe}_normal": normal}, **metal)).reflected
                 for normal in (-up, up))
    assert dark.max() == 0 < lit.max()


@pytest.mark.parametrize(("path", "lobe", "roughness"), [
    ("reflected", "layer", 0.1), ("reflected", "mirrored", 0.6), ("reflected", "reflected_gloss", 0.6),
    ("refracted", "refracted_gloss", 0.6), ("reflected", "mirrored", 0.1)])
def test_mirrors_and_glass_show_the_sky_in_gloss_at_which_paths_end(path, lobe, roughness):
    """As if what the camera sees were a mirror, or glass; at polished metal paths go on to the sky."""
    scene, (view, guides) = floor_scene(), floor_view()
    scene = replace(scene, environment=np.ones(ENVIRONMENT_SHAPE, np.float32), emission=np.zeros_like(scene.emission))
    scene.tiles[:, ROUGHNESS] = 0.02
    shape = guides.position.shape
    up, none = np.broadcast_to(np.float16((0, 0, 1)), shape), np.zeros(shape, np.float16)
    f0 = 0.04 if lobe == "layer" else 1.0
    values = {"position": np.broadcast_to(np.float32((0, 0, 0.5)), shape), "normal": up,
              "roughness": np.full((*shape[:2], 1), roughness, np.float16), "color": np.ones(shape, np.float16)}
    if lobe != "mirrored":
        values["f0"] = np.full((*shape[:2], 1), f0, np.float16)
    if lobe.endswith("gloss"):
        values["viewer"] = up
    paths = {f"{path}_position": guides.position, f"{path}_normal": up, f"{path}_color": none,
             f"{path}_light": np.zeros(shape, np.float32)}
    if path == "refracted":
        guides.transmission_color = guides.diffuse_color
    found = estimate_light(scene_light(scene), view, replace(
        guides, **paths, **{f"{lobe}_{kind}": value for kind, value in values.items()}))
    shown = getattr(found, path)[0][:, 32, 32].numpy()
    expected = 0.0 if (lobe, roughness) == ("mirrored", 0.1) else f0
    assert shown == pytest.approx(expected, rel=0.5 if lobe == "layer" else 0.05, abs=1e-6)


@pytest.mark.parametrize("lobe", ["exit", "inner"])
def test_rough_glass_shows_the_lamps_that_its_lobe_covers(lobe):
    """As if what the camera sees were glass, which light leaves upwards or downwards below the lamp."""
    scene, (view, guides) = floor_scene(), floor_view()
    shape = guides.position.shape
    up = np.broadcast_to(np.float16((0, 0, 1)), shape)
    glass = {"transmission_color": guides.diffuse_color, f"{lobe}_position": np.zeros(shape, np.float32),
             f"{lobe}_color": np.full(shape, 0.5, np.float16),
             f"{lobe}_roughness": np.full((*shape[:2], 1), 0.3, np.float16),
             "refracted_position": guides.position, "refracted_normal": up,
             "refracted_color": np.zeros(shape, np.float16), "refracted_light": np.zeros(shape, np.float32)}
    light = scene_light(scene)
    dark, lit = (estimate_light(light, view, replace(guides, **{f"{lobe}_normal": normal}, **glass)).direct[:, 2]
                 for normal in (-up, up))
    assert dark.max() == 0 < lit.max()


@pytest.mark.parametrize("roughness", [0.1, 0.6])
def test_what_was_traced_is_estimated_as_well_if_that_is_asked_for(roughness):
    """Together with the light that has bounced it is the picture without traced light."""
    scene, (view, guides) = walls((0.8, 0.3, 0.3)), floor_view()
    scene.tiles[:, ROUGHNESS] = roughness
    light, traced = scene_light(scene), replace(guides, traced=0.5 * guides.diffuse_color)
    plain = replace(FULL, edges=False, smoothings=0)  # highlights, edges and shadows beside traced light are coarser
    beside, untraced = (estimate_light(light, view, given, plain) for given in (traced, guides))
    assert not torch.equal(beside.bounces(), untraced.bounces())  # lobes share what traced light leaves out
    torch.testing.assert_close(beside.estimate() + beside.bounces(), untraced.radiance(), rtol=1e-3, atol=1e-4)
    alone = estimate_light(light, view, traced, plain, with_direct=False)
    assert not alone.direct.any() and torch.equal(alone.radiance(), beside.radiance())


def test_bounced_light_of_the_few_rays_of_large_pictures_is_that_of_many():
    light, (view, guides) = scene_light(walls((0.8, 0.3, 0.3))), floor_view()
    few, many = (estimate_light(light, view, guides, replace(FULL, probe_rays=rays, most_more=1.0)).bounced
                 for rays in (1.0, 32.0))
    assert (few - many).square().mean().sqrt() < 0.12 * many.mean()
