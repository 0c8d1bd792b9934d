# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles that pixels are said to see, against every triangle tried for every pixel."""
import numpy as np
import pytest

from renderformer_v2.model.camera import square_view, view_rays
from renderformer_v2.model.first_hits.from_passes import guides_from_passes, lies_between
from renderformer_v2.model.geometry import barycentric
from renderformer_v2.model.scene import RenderScene, View, Volumes, constant_tile

SIZE, NOTHING = 96, 1e10


def scattered_scene(count: int, light: bool) -> RenderScene:
    """Random parallelograms of two triangles in [-1, 1]^3; with `light` the first triangle is one no camera sees."""
    rng = np.random.default_rng(3)
    a, b, c = np.moveaxis(rng.uniform(-1, 1, (count // 2, 1, 3)) + rng.normal(size=(count // 2, 3, 3)) * 0.15, 1, 0)
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, a, a + b - c], axis=1)])
    if light:
        triangles[0] = [(-2, -2, 1.5), (2, -2, 1.5), (0, 3, 1.5)]  # in front of everything
    emission = np.zeros((count, 3), np.float32)
    emission[0] = 5.0 * light
    normals = np.tile(np.float32((0, 0, 1)), (count, 3, 1))
    return RenderScene(triangles.astype(np.float32), normals, emission, emission * 0, np.zeros((count, 2), np.float32),
                       np.zeros(count, np.int32), constant_tile((0.8, 0.8, 0.8), roughness=0.5, ior=1.5)[None])


def first_hits(triangles: np.ndarray, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index (S,), -1 if none, and distance (S,) of the nearest of `triangles` (N, 3, 3) along `rays` (S, 3)."""
    corner, edges = triangles[:, 0], triangles[:, 1:] - triangles[:, :1]
    columns = np.stack([np.broadcast_to(edges[:, 0], (len(rays), *corner.shape)),
                        np.broadcast_to(edges[:, 1], (len(rays), *corner.shape)),
                        np.broadcast_to(-rays[:, None], (len(rays), *corner.shape))], axis=-1)
    u, v, distance = np.moveaxis(np.linalg.solve(columns, (origin - corner)[None, ..., None])[..., 0], -1, 0)
    distance = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0), distance, NOTHING)
    return np.where(distance.min(1) < NOTHING, distance.argmin(1), -1), distance.min(1)


def nearest_triangles(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Every triangle tried for every point, by the point of it with the same weights of its corners, none negative."""
    found = []
    for point in points:
        weights = barycentric(triangles, np.broadcast_to(point, (len(triangles), 3))).clip(0, 1)
        weights /= weights.sum(axis=1, keepdims=True)
        found.append(np.linalg.norm((triangles * weights[..., None]).sum(axis=1) - point, axis=-1).argmin())
    return np.array(found)


@pytest.mark.parametrize("light", [False, True])
def test_pixels_belong_to_the_triangles_they_see(light):
    scene = scattered_scene(120, light)
    camera = np.eye(4, dtype=np.float32)
    camera[:3, 3] = 0.1, -0.2, 3.0
    view = square_view(camera, 45, SIZE)
    origin, rays = view_rays(view)
    seen = scene.triangles[1:] if light else scene.triangles
    triangle, distance = first_hits(seen.astype(np.float64), origin, rays.reshape(-1, 3).astype(np.float64))
    hit = (triangle >= 0).reshape(SIZE, SIZE)
    triangle = np.where(triangle >= 0, triangle + light, -1).reshape(SIZE, SIZE)
    assert 0.2 < hit.mean() < 0.9 and len(np.unique(triangle)) > 60
    distance = distance.reshape(SIZE, SIZE, 1)
    zero = np.zeros((SIZE, SIZE, 3), np.float32)
    passes = {name: zero for name in ("normal", "diffuse_color", "glossy_color", "transmission_color", "emission",
                                      "environment")}
    position = np.where(hit[..., None], origin + rays * distance, 0).astype(np.float32)
    passes |= {"alpha": hit[..., None] * np.float32(1), "depth": distance.astype(np.float32), "position": position}
    guides = guides_from_passes(passes, scene, view, nearest_triangles)

    assert (guides.hit_triangle[~hit] == -1).all()
    assert (guides.hit_triangle == triangle)[hit].mean() > 0.995  # the rest lies on an edge that two triangles share
    weights = np.concatenate([guides.hit_barycentric, 1 - guides.hit_barycentric.sum(-1, keepdims=True)], axis=-1)
    on_triangle = (scene.triangles[guides.hit_triangle] * weights[..., None]).sum(axis=-2)
    np.testing.assert_allclose(on_triangle[hit], position[hit], atol=2e-3)


def floor_and_wall() -> tuple[RenderScene, View, dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """They meet in a row of pixels, in which Cycles gives the mean of their normals; normals without it, and the row.
    """
    wall = np.float32([[(-1, 0, 0), (1, 0, 0), (1, 1, 0)], [(-1, 0, 0), (1, 1, 0), (-1, 1, 0)]])
    floor = np.float32([[(-1, 0, 0), (1, 0, 1), (1, 0, 0)], [(-1, 0, 0), (-1, 0, 1), (1, 0, 1)]])
    normals = np.repeat(np.float32([(0, 0, 1)] * 2 + [(0, 1, 0)] * 2)[:, None], 3, axis=1)
    rows = np.zeros((4, 3), np.float32)
    scene = RenderScene(np.concatenate([wall, floor]), normals, rows, rows, rows[:, :2], np.zeros(4, np.int32),
                        constant_tile((0.8, 0.8, 0.8))[None])
    camera = np.eye(4, dtype=np.float32)
    camera[:3, 3] = 0, 0.5, 2
    view = square_view(camera, 45, SIZE)
    origin, rays = view_rays(view)
    distance = np.minimum(2 / -rays[..., 2], 0.5 / -rays[..., 1].clip(None, -1e-9))
    position = (origin + rays * distance[..., None]).astype(np.float32)
    on_wall = position[..., 2] < 1e-4
    exact = np.where(on_wall[..., None], np.float32((0, 0, 1)), np.float32((0, 1, 0)))
    edge = np.zeros((SIZE, SIZE), bool)
    edge[1:] = on_wall[1:] != on_wall[:-1]
    assert SIZE <= edge.sum() < 3 * SIZE
    mean = np.where(edge[..., None], np.float32((0, 0.5, 0.5)), exact)
    zero, ones = np.zeros_like(position), np.ones((SIZE, SIZE, 1), np.float32)
    passes = {name: zero for name in ("diffuse_color", "glossy_color", "transmission_color", "emission", "environment")}
    passes |= {"normal": mean, "alpha": ones, "depth": distance[..., None].astype(np.float32), "position": position}
    return scene, view, passes, exact, edge


def test_a_pixel_of_several_surfaces_takes_the_normal_of_the_one_in_its_middle():
    scene, view, passes, exact, edge = floor_and_wall()
    guides = guides_from_passes(passes, scene, view, nearest_triangles)
    np.testing.assert_allclose(guides.normal, exact, atol=1e-5)
    assert guides.normal_variance is None
    bumpy = guides_from_passes(passes | {"normal": 0.98 * passes["normal"]}, scene, view, nearest_triangles)
    assert bumpy.normal_variance[0, 0] == pytest.approx(1 - 0.98 ** 2, rel=1e-4)
    assert bumpy.normal_variance[edge].max() < 0.04  # without bumps the mean of both is short enough


def test_fog_before_a_surface_is_no_bump():
    """Samples that scatter in it have no normal, and cover a pixel."""
    scene, view, passes, exact, _ = floor_and_wall()
    one = np.ones((1, 3), np.float32)
    scene.volumes = Volumes(np.ones((1, 64), np.float32), 0 * one, 0 * one, 20 * one, one, one)
    guides = guides_from_passes(passes | {"normal": 0.7 * passes["normal"]}, scene, view, nearest_triangles)
    assert guides.normal_variance is None
    np.testing.assert_allclose(guides.normal, exact, atol=1e-5)


@pytest.mark.parametrize("normal, expected", [
    ((0, 0.1, 1), True),      # of a pixel that sees a little of the other facet
    ((0, 0.0, 1), True),
    ((0, 0.4, 1), True),      # of the other facet alone
    ((0.3, 0.1, 1), False),   # of a bump
    ((0, -0.3, 1), False),
])
def test_the_mean_normal_of_two_facets_lies_between_theirs(normal, expected):
    facets = np.float32([[(0, 0, 1)] * 3, [(0, 0.4, 1)] * 3])
    facets /= np.linalg.norm(facets, axis=-1, keepdims=True)
    mean = np.float32(normal) / np.linalg.norm(normal)
    between = lies_between(np.broadcast_to(mean.astype(np.float32), facets.shape), facets)
    assert between[0].all() == expected and between[0].any() == expected


def test_on_one_surface_bumps_stay_as_they_are():
    flat = np.broadcast_to(np.float32((0, 0, 1)), (4, 4, 3))
    assert not lies_between(flat, flat).any()


@pytest.mark.parametrize("traced", [False, True])
def test_hair_is_diffuse_where_its_light_is_not_traced(traced):
    """Cycles' passes have the colour of hair as a whole as gloss, which says little of a fibre's light."""
    scene = scattered_scene(120, light=False)
    scene.fibre = np.ones(1, np.float32)
    view = square_view(np.block([[np.eye(3), np.float32([[0.1], [-0.2], [3]])], [np.float32([0, 0, 0, 1])]]), 45, SIZE)
    origin, rays = view_rays(view)
    triangle, distance = first_hits(scene.triangles.astype(np.float64), origin, rays.reshape(-1, 3).astype(np.float64))
    hit, distance = (triangle >= 0).reshape(SIZE, SIZE, 1), distance.reshape(SIZE, SIZE, 1)
    zero, inner = np.zeros((SIZE, SIZE, 3), np.float32), hit[..., 0]
    for axis in (0, 1):
        inner = inner & np.roll(inner, 2, axis) & np.roll(inner, -2, axis)
    passes = {name: zero for name in ("normal", "diffuse_color", "transmission_color", "emission", "environment")}
    passes |= {"alpha": np.float32(hit), "depth": distance.astype(np.float32)}
    passes |= {"glossy_color": zero + hit * np.float32(0.01),
               "position": np.where(hit, origin + rays * distance, 0).astype(np.float32)}
    guides = guides_from_passes(passes | ({"traced": zero} if traced else {}), scene, view, nearest_triangles)
    if traced:
        np.testing.assert_array_equal(guides.glossy_color, passes["glossy_color"])
    else:
        assert not guides.glossy_color[inner].any()
        assert np.median(guides.diffuse_color[inner]) == pytest.approx(0.8, abs=1e-3)
    assert passes["diffuse_color"] is zero and not zero.any()


def test_what_cameras_do_not_see_is_not_what_a_distant_camera_saw():
    """As from an orthographic one, which counts as far away: a lamp hangs in the picture's middle, before a wall."""
    far, size = 100.0, 1.0
    corners = np.float32([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * size
    square = corners[[(0, 1, 2), (0, 2, 3)]]
    back = square * np.float32(0.3) + np.float32((0, 0, 0.5))  # within 1 % of the distance before the wall
    rows = np.zeros((4, 3), np.float32)
    scene = RenderScene(np.concatenate([square, back]), np.tile(np.float32((0, 0, 1)), (4, 3, 1)), rows, rows,
                        rows[:, :2], np.zeros(4, np.int32), constant_tile((0.8, 0.8, 0.8))[None],
                        seen=np.array([True, True, False, False]))
    camera = np.eye(4, dtype=np.float32)
    camera[2, 3] = far
    view = square_view(camera, np.degrees(2 * np.arctan(0.9 / far)), SIZE)
    origin, rays = view_rays(view)
    distance = -far / rays[..., 2:]
    position = (origin + rays * distance).astype(np.float32)
    zero, ones = np.zeros_like(position), np.ones((SIZE, SIZE, 1), np.float32)
    passes = {name: zero for name in ("diffuse_color", "glossy_color", "transmission_color", "emission", "environment")}
    passes |= {"normal": zero + np.float32((0, 0, 1)), "alpha": ones, "depth": distance.astype(np.float32),
               "position": position}
    guides = guides_from_passes(passes, scene, view, nearest_triangles)
    assert (guides.hit_triangle < 2).all()
    np.testing.assert_allclose(guides.position, position, atol=1e-3)


def test_beside_a_silhouette_fog_alone_is_no_surface():
    """A medium covers pixels as surfaces do."""
    scene = scattered_scene(12, light=False)
    one = np.ones((1, 3), np.float32)
    scene.volumes = Volumes(np.ones((1, 64), np.float32), 0 * one, 0 * one, 20 * one, one, one)
    view = square_view(np.block([[np.eye(3), np.float32([[0.1], [-0.2], [3]])], [np.float32([0, 0, 0, 1])]]), 45, SIZE)
    origin, rays = view_rays(view)
    triangle, distance = first_hits(scene.triangles.astype(np.float64), origin, rays.reshape(-1, 3).astype(np.float64))
    hit, distance = (triangle >= 0).reshape(SIZE, SIZE, 1), distance.reshape(SIZE, SIZE, 1)
    sliver = np.roll(hit, 1, 1) & ~hit  # of which a surface covers a little, but not the middle
    zero = np.zeros((SIZE, SIZE, 3), np.float32)
    passes = {name: zero for name in ("diffuse_color", "glossy_color", "transmission_color", "emission", "environment")}
    passes |= {"alpha": np.where(hit, 1, 0.9).astype(np.float32), "depth": distance.astype(np.float32),
               "normal": zero + np.where(hit | sliver, np.float32(0.1), 0),
               "position": np.where(hit, origin + rays * distance, 0).astype(np.float32)}
    guides = guides_from_passes(passes, scene, view, nearest_triangles)
    shows = (hit | sliver)[..., 0]
    assert 0.02 < shows.mean() < 0.8
    np.testing.assert_array_equal(guides.hit_triangle >= 0, shows)
