# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths past mirrors and glass end where geometry says, with the colours of what they passed."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.geometry import reflected, refracted
from renderformer_v2.model.light.specular.facets import pixel_starts
from renderformer_v2.model.light.specular.follow_paths import follow_paths
from renderformer_v2.model.light.specular.glass import mirrored_by_plates
from renderformer_v2.model.light.specular.paths import SURFACES, Casts, PathEnds
from renderformer_v2.model.material.reflectance import fresnel
from renderformer_v2.model.scene import EMISSION_SIZE, RenderScene, constant_tile

RED, GOLD = (0.8, 0.1, 0.1), (1.0, 0.7, 0.3)


def square(x: float, facing: float) -> np.ndarray:
    """Two triangles across the X axis, their front towards `facing`."""
    a, b, c, d = (np.float32((x, y, z)) for y, z in ((-9, -9), (9, -9), (9, 9), (-9, 9)))
    return np.stack([(a, b, c), (a, c, d)]) if facing > 0 else np.stack([(a, c, b), (a, d, c)])


def walls(*materials: tuple[float, float, np.ndarray], shines: bool = False) -> RenderScene:
    """Squares across the X axis: (x, facing, tile) each."""
    triangles = np.concatenate([square(x, facing) for x, facing, _ in materials])
    normals = np.repeat([(np.sign(facing), 0, 0) for _, facing, _ in materials], 2, axis=0)
    n = len(triangles)
    emission = np.zeros((n, 3), np.float32)
    emission[-2:] = float(shines)
    return RenderScene(triangles, np.float32(normals)[:, None].repeat(3, 1), emission, np.zeros((n, 3), np.float32),
                       np.zeros((n, 2), np.float32), np.arange(n, dtype=np.int32) // 2,
                       np.stack([tile for _, _, tile in materials]))


def along_x(scene: RenderScene):
    """A cast for squares across the X axis that no ray misses sideways."""
    x = scene.triangles[:, 0, 0]

    def cast(origins, rays):
        distance = (x[None] - origins[:, :1]) / rays[:, :1]
        distance[distance <= 0] = np.inf
        nearest = distance.argmin(1)
        found = distance[np.arange(len(rays)), nearest]
        return np.where(np.isfinite(found), nearest, -1).astype(np.int32), np.where(np.isfinite(found), found, 0)

    return cast


def ends(scene: RenderScene, direction=(1.0, 0.0, 0.0), error=0.0):
    """error: by which distances are found too short."""
    ray, exact = np.float64([direction]), along_x(scene)

    def cast(origins, rays):
        triangle, distance = exact(origins, rays)
        return triangle, np.maximum(distance - error, 0)

    return follow_paths(scene, Casts(cast), np.zeros((1, 3)), ray / np.linalg.norm(ray), eye=np.float32((-5, 0, 0)))


def shown(found: PathEnds) -> np.ndarray:
    """(P, 3) what paths show of light that a white diffuse surface sends on."""
    return found.share * found.albedo


def test_a_path_ends_at_the_first_matte_surface():
    found = ends(walls((2, -1, constant_tile(RED)), (-1, 1, constant_tile())))
    np.testing.assert_allclose(found.position, [(2, 0, 0)], atol=1e-5)
    np.testing.assert_allclose(found.normal, [(-1, 0, 0)], atol=1e-5)
    np.testing.assert_allclose(shown(found), [RED], atol=1e-3)


def test_a_mirror_sends_a_path_on_and_colours_it():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.1)
    found = ends(walls((2, -1, mirror), (-1, 1, constant_tile(RED))), (1, 0.5, 0))
    np.testing.assert_allclose(found.position, [(-1, 2.5, 0)], atol=1e-2)
    np.testing.assert_allclose(shown(found), [np.multiply(GOLD, RED)], atol=2e-3)


def pictured(scene: RenderScene) -> RenderScene:
    """The last square red where the weight of corner 0 is below a half, and green elsewhere, twice as bright."""
    tile = np.zeros((1, 3, EMISSION_SIZE, EMISSION_SIZE), np.float16)
    tile[0, 0, :, :EMISSION_SIZE // 2], tile[0, 1, :, EMISSION_SIZE // 2:] = 1, 2
    return replace(scene, emission_tile=np.int32([-1] * (len(scene) - 2) + [0, 0]), emission_tiles=tile)


@pytest.mark.parametrize(("direction", "expected"), [((1, 2, 1), (1, 0, 0)), ((1, -2, -2.5), (0, 2, 0))])
def test_a_path_shows_the_picture_on_a_screen(direction, expected):
    found = ends(pictured(walls((2, -1, constant_tile()), shines=True)), direction)
    np.testing.assert_allclose(found.light, [expected], atol=1e-5)


def test_a_path_shows_what_glows_where_it_ends_and_where_it_is_mirrored():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.1)
    scene = pictured(walls((2, -1, mirror), (-1, 1, constant_tile(RED))))
    scene.glow = np.float32([(0.1, 0.1, 0.1)] * 2 + [(0.2, 0.2, 0.2)] * 2)
    found = ends(scene, (1, 0.5, 0))
    np.testing.assert_allclose(found.light, 0.1 + np.multiply([(0.2, 0, 0)], GOLD), atol=2e-3)
    np.testing.assert_allclose(shown(found), [np.multiply(GOLD, RED)], atol=2e-3)


def test_a_rough_metal_ends_a_path_with_its_lobe():
    rough, polished = (constant_tile(GOLD, metallic=1.0, roughness=roughness) for roughness in (0.8, 0.1))
    found = ends(walls((2, -1, rough)))
    assert not shown(found).any() and not found.gloss.color.any()
    np.testing.assert_allclose(found.lobe.color, [GOLD], atol=1e-3)
    found = ends(walls((2, -1, polished), (-1, 1, rough)), (1, 0.5, 0))
    assert not shown(found).any()
    np.testing.assert_allclose(found.gloss.color, [np.square(GOLD)], atol=2e-3)
    found = ends(walls((2, -1, polished), (-1, 1, polished), (3, -1, constant_tile()), (-2, 1, rough)), (1, 0.5, 0))
    assert shown(found).any()  # where a lobe was met before, rough metal is matte


@pytest.mark.parametrize(("tile", "color", "f0"), [
    (constant_tile(RED, roughness=0.3, ior=1.5), (1, 1, 1), 0.08),
    (constant_tile(GOLD, metallic=1.0, roughness=0.3), GOLD, 1.0),
    (constant_tile(GOLD, metallic=1.0, roughness=0.6), GOLD, 1.0)])
def test_what_glass_shows_has_a_lobe_in_the_colour_of_the_glass(tile, color, f0):
    pane = constant_tile((0.25, 1, 1), roughness=0.0, ior=1.0, transmission=1.0)
    scene, ray = walls((1, 1, pane), (4, -1, tile)), np.float64([(0.8, 0.6, 0)])
    gloss = follow_paths(scene, Casts(along_x(scene)), np.zeros((1, 3)), ray, np.float32((-5, 0, 0)),
                         start=np.zeros((1, 2), np.float32)).gloss
    np.testing.assert_allclose(gloss.position, [(4, 3, 0)], atol=2e-3)
    np.testing.assert_allclose(gloss.normal, [(-1, 0, 0)], atol=1e-5)
    np.testing.assert_allclose(gloss.viewer, -ray, atol=1e-5)
    np.testing.assert_allclose(gloss.color, [np.multiply(color, (0.5, 1, 1))], atol=2e-3)
    np.testing.assert_allclose(gloss.f0, [(f0,)], atol=1e-3)


@pytest.mark.parametrize(("slope", "ior"), [(0.0, 1.5), (1.0, 1.5), (1.0, 1.0), (0.8, 0.75)])
def test_a_pane_shifts_a_path_by_its_thickness(slope, ior):
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=ior, transmission=1.0)
    found = ends(walls((1, -1, glass), (2, 1, glass), (4, -1, constant_tile(RED))), (1, slope, 0))
    inside = slope / np.sqrt(1 + slope**2) / ior
    height = 3 * slope + inside / np.sqrt(1 - inside**2)  # one unit of glass among four
    np.testing.assert_allclose(found.position, [(4, height, 0)], atol=2e-3)
    mirrored = fresnel(np.array([1 / np.sqrt(1 + slope**2)]), np.array([ior]))
    np.testing.assert_allclose(shown(found), np.divide(RED, 1 + mirrored)[None], atol=1e-3)


def test_each_surface_of_glass_tints_by_the_root_of_its_colour_as_cycles_principled_bsdf_does():
    glass = constant_tile((0.81, 0.25, 0.04), roughness=0.0, ior=1.5, transmission=1.0)
    white = constant_tile((1, 1, 1))
    once, twice = (ends(walls(*[(x, -1, glass) for x in panes], (4, -1, white))) for panes in ((1,), (1, 2)))
    np.testing.assert_allclose(shown(once), [(0.9, 0.5, 0.2)], atol=1e-3)
    np.testing.assert_allclose(shown(twice), [(0.81, 0.25, 0.04)], atol=1e-3)


def test_a_path_ends_at_milky_glass_and_not_at_clear_glass():
    for transmission, end, color in (0.6, 1, 0.4), (0.9, 4, 1.0):
        glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.2, transmission=transmission)
        found = ends(walls((1, -1, glass), (4, -1, constant_tile((1, 1, 1)))))
        np.testing.assert_allclose(found.position, [(end, 0, 0)], atol=1e-5)
        np.testing.assert_allclose(shown(found), [(color,) * 3], atol=1e-2)  # its layer reflects a hundredth


def test_a_layer_takes_what_it_reflects_from_the_matte_surface_below_it():
    for slope, layer in (0.0, 0.04), (2.0, 0.1):
        found = ends(walls((1, -1, constant_tile((1, 1, 1), roughness=0.1, ior=1.3291))), direction=(1, slope, 0))
        np.testing.assert_allclose(shown(found), 1 - layer, atol=0.02)


def test_a_path_leaves_glass_that_is_partly_matte_from_inside():
    for transmission, color in (0.6, 1.0), (0.3, 0.5), (0.05, None):
        back = constant_tile((1, 1, 1), roughness=0.0, ior=1.2, transmission=transmission)
        found = ends(walls((1, 1, back), (4, -1, constant_tile((1, 1, 1)))))
        np.testing.assert_allclose(found.position, [(4 if color else 1, 0, 0)], atol=1e-5)
        np.testing.assert_allclose(shown(found), [(color or 1 - transmission,) * 3], atol=0.02)  # likewise


def test_glass_that_is_partly_metal_lets_less_through_and_mirrors_some_of_that_once_more_inside():
    part = constant_tile((0.25, 1, 1), roughness=0.0, ior=1.5, transmission=1.0, metallic=0.4)
    white = constant_tile((1, 1, 1))
    entered, left = (ends(walls((1, side, part), (4, -1, white))) for side in (-1, 1))
    np.testing.assert_allclose(shown(entered), [(0.3, 0.6, 0.6)], atol=1e-3)
    np.testing.assert_allclose(shown(left), [(0.35, 1, 1)], atol=1e-3)


def test_paths_end_in_the_light_of_lamps_and_of_the_sky_in_the_colour_of_the_glass_before_these():
    pane = (1, -1, constant_tile((0.25, 1, 1), roughness=0.0, ior=1.0, transmission=1.0))
    sky = np.zeros((4, 8, 3), np.float32)
    sky[1:3, 3:5] = 0.2, 0.4, 0.6  # around +X
    open_, lit = walls(pane), walls(pane, (2, -1, constant_tile(RED)), shines=True)
    for scene, light in (open_, 0), (replace(open_, environment=sky), sky[1, 3]), (lit, 1):
        found = ends(scene)
        assert not shown(found).any()
        np.testing.assert_allclose(found.light, np.multiply((0.5, 1, 1), light)[None], atol=1e-3)


def test_a_spot_shows_nothing_of_its_beam_beside_it():
    lit = walls((2, -1, constant_tile(RED)), shines=True)
    lit.beam_axis[:] = 0, 0, 1
    assert not ends(lit).light.any()


def test_two_mirrors_end_after_a_while_as_if_the_last_were_matte():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.0)
    found = ends(walls((1, -1, mirror), (-1, 1, mirror)))
    np.testing.assert_allclose(shown(found), [np.power(GOLD, SURFACES)], atol=2e-3)
    np.testing.assert_allclose(found.position, [(-1, 0, 0)], atol=1e-2)
    assert not found.light.any()


def test_plates_mirror_at_both_sides_and_what_is_no_plate_at_one():
    pane = constant_tile((0.81, 1, 0.25), roughness=0.0, ior=1.5, transmission=1.0)
    ray = np.float64([(0.6, 0.8, 0)])
    share = fresnel(np.array([0.6]), np.array([1.5]))

    def gain(*materials):
        scene = walls(*materials)
        return mirrored_by_plates(scene, along_x(scene), np.float64([(1, 0, 0)]), np.full((1, 1), 1e-4), ray,
                                  np.float64([(-1, 0, 0)]), scene.tiles[:1, :, 0, 0].astype(np.float32),
                                  np.zeros(1, bool))
    both = 1 + np.multiply((0.81, 1, 0.25), (1 - share) / (1 + share))
    np.testing.assert_allclose(gain((1, -1, pane), (1.5, 1, pane)), [both], atol=2e-3)
    for other in ((1.5, -1, pane), (1.5, 1, constant_tile(RED))):
        np.testing.assert_array_equal(gain((1, -1, pane), other), 1)


def test_what_never_leaves_glass_is_lost_after_a_while():
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.5, transmission=1.0)
    found = ends(walls((1, 1, glass), (-1, -1, glass)), (0.5, 0.8, 0))
    assert not shown(found).any() and not found.light.any()


def test_light_that_normals_send_out_of_glass_and_facets_do_not_is_lost_as_in_cycles():
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.5, transmission=1.0)
    scene, grazing = walls((2, 1, glass), (-1, 1, constant_tile(RED))), (0.1045, 0.9945, 0)
    np.testing.assert_allclose(shown(ends(scene, grazing)), [RED], atol=2e-3)  # mirrored
    scene.normals[:2] = 0.5 ** 0.5, 0.5 ** 0.5, 0
    assert not shown(ends(scene, grazing)).any()


def test_light_that_cannot_enter_air_in_water_is_mirrored():
    air = constant_tile((1, 1, 1), roughness=0.0, ior=0.75, transmission=1.0)
    found = ends(walls((1, -1, air), (2, 1, air), (-4, 1, constant_tile(RED))), (1, 2, 0))
    np.testing.assert_allclose(found.position, [(-4, 12, 0)], atol=2e-3)


def test_light_that_cannot_leave_glass_is_mirrored():
    ray, normal = np.float64([(0.8, 0.6, 0)]), np.float64([(-1, 0, 0)])
    flat = np.float64([(0.6, 0.8, 0)])
    ior, inside = np.array([1.5]), np.array([True])
    np.testing.assert_allclose(refracted(flat, normal, ior, inside), reflected(flat, normal))
    through = refracted(ray, normal, np.array([1.2]), inside)
    np.testing.assert_allclose(np.linalg.norm(through, axis=1), 1)
    np.testing.assert_allclose(through[0, 1], 0.72)


def test_a_path_is_not_held_by_a_surface_that_it_meets_where_it_starts():
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.5, transmission=1.0)
    found = ends(walls((1e-5, -1, glass), (1, 1, glass), (4, -1, constant_tile(RED))), error=1e-5)
    np.testing.assert_allclose(shown(found), [RED], atol=1e-3)


def test_far_from_the_worlds_origin_a_path_leaves_the_surface_at_which_it_starts():
    start = np.float32([(1e5, 0, 0)])
    rounded = np.nextafter(start[0, 0], np.float32(np.inf))
    scene = walls((rounded, -1, constant_tile(GOLD)), (1e5 + 4, -1, constant_tile(RED)))
    found = follow_paths(scene, Casts(along_x(scene)), start, np.float32([(1, 0, 0)]), eye=start[0] - (5, 0, 0))
    np.testing.assert_allclose(shown(found), [RED], atol=1e-3)


def test_a_path_ends_at_what_glass_stands_on_whichever_of_both_a_ray_happens_to_meet():
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.5, transmission=1.0)
    scene = walls((1, -1, glass), (3, 1, glass), (3, -1, constant_tile(RED)), (5, -1, constant_tile(GOLD)))
    cast, start, ray = along_x(scene), np.zeros((1, 3)), np.float64([(1, 0, 0)])
    solid = walls((3 + 1e-5, -1, constant_tile(RED)), (5, -1, constant_tile(GOLD)))
    beyond = along_x(solid)

    def of_solid(origins, rays):
        triangle, distance = beyond(origins, rays)
        return np.where(triangle >= 0, triangle + 4, -1), distance
    without, found = (follow_paths(scene, Casts(cast, solid), start, ray, np.float32((-5, 0, 0)))
                      for solid in (None, of_solid))
    np.testing.assert_allclose(shown(without), [np.divide(GOLD, 1.04)], atol=1e-3)  # as a plate mirrors twice
    np.testing.assert_allclose(shown(found), [np.divide(RED, 1.04)], atol=1e-3)


@pytest.mark.parametrize("gap, color", [(0.0, (0, 0, 0)), (1e-3, np.divide(RED, 1.04))])
def test_what_lies_in_one_plane_with_glass_is_black_behind_it_as_in_cycles(gap, color):
    glass = constant_tile((1, 1, 1), roughness=0.0, ior=1.5, transmission=1.0)
    scene = walls((1, -1, glass), (3, 1, glass), (3 + gap, -1, constant_tile(RED)))
    panes, wall = (replace(scene, triangles=scene.triangles.copy()) for _ in range(2))
    panes.triangles[4:], wall.triangles[:4] = -9, -9  # behind all
    start, ray = np.zeros((1, 3)), np.float64([(1, 0, 0)])
    casts = Casts(*map(along_x, (scene, wall, panes)))
    found = follow_paths(scene, casts, start, ray, np.float32((-5, 0, 0)), start=pixel_starts(*np.zeros((2, 1))))
    np.testing.assert_allclose(shown(found), [color], atol=1e-3)


def test_lamps_in_a_mirror_that_a_mirror_or_glass_shows_are_left_to_its_highlights():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.1)
    scene, origin = walls((2, -1, mirror), (-1, 1, constant_tile()), shines=True), np.zeros((1, 3))
    ray = np.float64([(1, 0, 0)])
    mirrored, through = (follow_paths(scene, Casts(along_x(scene)), origin, ray, np.float32((-5, 0, 0)), start=start)
                         for start in (None, np.zeros((1, 2), np.float32)))
    assert not mirrored.gloss.color.any() and not through.lobe.color.any()
    for found, lobe in (mirrored, mirrored.lobe), (through, through.gloss):
        assert not found.light.any()
        np.testing.assert_allclose(lobe.position, [(2, 0, 0)], atol=1e-5)
        np.testing.assert_allclose(lobe.color, [GOLD], atol=1e-3)
        assert lobe.roughness[0, 0] == pytest.approx(0.1, abs=1e-3)


def through_back(roughness: float, shines: bool = False) -> PathEnds:
    """25 paths of neighbours that leave coloured glass at X = 1 before a wall at X = 4."""
    back = constant_tile((0.25, 1, 1), roughness=roughness, ior=1.5, transmission=1.0)
    scene = walls((1, 1, back), (4, -1, constant_tile(RED)), shines=shines)
    rows, columns = (x.ravel() for x in np.mgrid[:5, :5])
    rays = np.broadcast_to(np.float64((1, 0, 0)), (25, 3))
    return follow_paths(scene, Casts(along_x(scene)), np.zeros((25, 3)), rays, np.float32((-5, 0, 0)),
                        start=pixel_starts(rows, columns))


def test_neighbours_that_look_through_rough_glass_see_what_its_lobe_covers():
    smooth, rough, rougher = (through_back(roughness).position[:, 1:] for roughness in (0.1, 0.3, 0.4))
    assert np.abs(smooth).max() < 1e-5
    assert 0.05 < rough.std() < rougher.std() < 2 and np.abs(rough.mean(0)).max() < 0.1


def test_lamps_behind_rough_glass_are_left_to_its_lobe():
    smooth, rough = (through_back(roughness, shines=True) for roughness in (0.1, 0.3))
    np.testing.assert_allclose(smooth.light, [(0.5, 1, 1)] * 25, atol=1e-3)
    assert not smooth.lobe.color.any() and not rough.light.any()
    np.testing.assert_allclose(rough.lobe.position, [(1, 0, 0)] * 25, atol=1e-5)
    np.testing.assert_allclose(rough.lobe.normal, [(1, 0, 0)] * 25, atol=1e-5)
    assert rough.lobe.color[:, 0] == pytest.approx(rough.lobe.color[:, 1] / 2) and rough.lobe.color[0, 1] > 0.9


def test_the_layer_that_a_mirror_shows_has_a_lobe():
    for tile, share, f0 in ((constant_tile(RED, roughness=0.3, ior=1.5), 1, 0.08),
                            (constant_tile(RED, roughness=0.3, ior=1.0), 0, 0),
                            (constant_tile(GOLD, metallic=1.0, roughness=0.3, ior=1.5), 0, 0.08),
                            (constant_tile((1, 1, 1), roughness=0.3, ior=2.0, transmission=1.0), 1, 1 / 9)):
        layer = ends(walls((2, -1, tile), (-1, 1, constant_tile()))).other
        np.testing.assert_allclose(layer.color, [(share,) * 3], atol=1e-3)
        np.testing.assert_allclose(layer.f0, [(f0,)], atol=1e-3)
        np.testing.assert_allclose(layer.position, [(2, 0, 0)], atol=1e-5)
        np.testing.assert_allclose(layer.normal, [(-1, 0, 0)], atol=1e-5)
        assert layer.roughness[0, 0] == pytest.approx(0.3, abs=1e-3)


def test_glass_has_a_lobe_where_its_inside_mirrors_paths_back_out():
    """From within a pane between X = -1 and 1."""
    for roughness, metallic in (0.0, 0.0), (0.3, 0.0), (0.3, 0.4):
        glass = constant_tile((1, 1, 1), roughness=roughness, ior=1.5, transmission=1.0, metallic=metallic)
        scene = walls((-1, -1, glass), (1, 1, glass), (4, -1, constant_tile(RED)))
        start, ray, eye = np.zeros((1, 3)), np.float64([(1, 0, 0)]), np.float32((-0.5, 0, 0))
        inner = follow_paths(scene, Casts(along_x(scene)), start, ray, eye,
                             start=pixel_starts(*np.zeros((2, 1), int))).other
        np.testing.assert_allclose(inner.position, [(-1, 0, 0)], atol=2e-3)
        np.testing.assert_allclose(inner.normal, [(-1, 0, 0)], atol=1e-3)
        mirrors = metallic + (1 - metallic) * 0.04
        assert 0.85 * mirrors < inner.color[0, 0] <= mirrors
        assert roughness < inner.roughness[0, 0] < roughness + 0.1


def test_the_beam_of_a_lamp_is_seen_from_where_it_shines():
    for axis, radiance in ((1, 1), (-1, 0)):
        scene = walls((2, -1, constant_tile()), shines=True)
        scene.beam_axis[:], scene.beam_cosine[:] = (-axis, 0, 0), (0.5, 0.6)
        assert ends(scene).light == pytest.approx(np.full((1, 3), float(radiance)))


def test_a_path_passes_the_back_of_a_lamp():
    scene = walls((3, -1, constant_tile(RED)), (2, -1, constant_tile()), shines=True)
    scene.beam_axis[2:], scene.seen = (1, 0, 0), np.array([True, True, False, False])
    np.testing.assert_allclose(shown(ends(scene)), [RED], atol=1e-3)
    assert not shown(ends(replace(scene, seen=None))).any()  # a surface that shines to one side


def test_what_is_seen_through_a_medium_is_dimmed_by_the_length_of_every_segment():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.1)
    scene, start, ray = walls((2, -1, mirror), (-1, 1, constant_tile())), np.zeros((1, 3)), np.float64([(1, 0, 0)])
    casts, eye = Casts(along_x(scene)), np.float32((-5, 0, 0))
    clear, dimmed = (follow_paths(scene, casts, start, ray, eye, media=each) for each in (
        None, lambda begin, direction, distance: np.exp(-distance[:, None] * np.float32((0.1, 0.2, 0.3)))))
    np.testing.assert_allclose(shown(dimmed) / shown(clear), [np.exp(-5 * np.float32((0.1, 0.2, 0.3)))], rtol=1e-3)


def test_fire_shines_on_every_segment_in_the_colour_of_the_mirror_before_it():
    mirror = constant_tile(GOLD, metallic=1.0, roughness=0.1)
    scene, start, ray = walls((2, -1, mirror), (-1, 1, constant_tile())), np.zeros((1, 3)), np.float64([(1, 0, 0)])
    found = follow_paths(scene, Casts(along_x(scene)), start, ray, np.float32((-5, 0, 0)),
                         fire=lambda begin, direction, distance: distance[:, None] * np.ones((1, 3)))
    np.testing.assert_allclose(found.light, [2 + 3 * np.float32(GOLD)], rtol=2e-3)
