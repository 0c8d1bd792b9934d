# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials at pixels: what is asked, what becomes of the answer, and when the tile is good enough."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.at_pixels import BLUR, Appearance
from renderformer_v2.model.first_hits.camera_rays import SPREAD, cast_guides
from renderformer_v2.model.first_hits.hit_materials import hit_roughness
from renderformer_v2.model.scene import METALLIC, ROUGHNESS, RenderScene, View, constant_tile

FORWARD = np.float32([(1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)])  # along Y, Z is up
FOCAL, DISTANCE = 12, 4
VIEW = View(FORWARD, np.float32([FOCAL, FOCAL]), np.float32([4, 3]), 8, 6)
TILE = 0.5  # colour of the tokens


@pytest.fixture
def wall():
    """A square that fills the picture, of two triangles."""
    corners = np.float32([[(-9, 4, -9), (9, 4, -9), (9, 4, 9)], [(-9, 4, -9), (9, 4, 9), (-9, 4, 9)]])
    return RenderScene(triangles=corners, normals=np.broadcast_to(np.float32((0, -1, 0)), (2, 3, 3)).copy(),
                       emission=np.zeros((2, 3), np.float32), beam_axis=np.zeros((2, 3), np.float32),
                       beam_cosine=np.zeros((2, 2), np.float32), tile_index=np.zeros(2, np.int32),
                       tiles=constant_tile((TILE,) * 3)[None])


class Striped:
    """Red left of x = `edge`, else green, and rough; nothing is known of triangle 1 where `knows_one` says so."""

    def __init__(self, corners, edge=0.0, knows_one=False, normal=None):
        self.corners, self.edge, self.knows_one, self.normal = corners, edge, knows_one, normal
        self.asked, self.steps = [], []

    def groups(self, triangle):
        return np.where(triangle >= 0, 0, -1)

    def at(self, triangle, weights, normal, steps):
        point = np.einsum("pk,pkc->pc", weights, self.corners[triangle])
        self.asked.append(point)
        self.steps.append(np.einsum("pak,pkc->pac", steps(np.arange(len(triangle))), self.corners[triangle]))
        seen = Appearance.empty(normal)
        seen.is_known[:] = (triangle == 0) | (not self.knows_one)
        seen.texel[:, 0], seen.texel[:, 1] = point[:, 0] < self.edge, point[:, 0] >= self.edge
        seen.texel[:, ROUGHNESS], seen.texel[:, METALLIC] = 0.25, 0
        seen.texel[:, 5] = 1
        if self.normal is not None:
            seen.normal[:] = self.normal
        return seen


def test_pixels_show_what_materials_are_like_there(wall):
    guides = cast_guides(wall, VIEW, materials=Striped(wall.triangles, edge=0))
    np.testing.assert_allclose(guides.diffuse_color[:, :4], np.broadcast_to((1, 0, 0), (6, 4, 3)), atol=1e-6)
    np.testing.assert_allclose(guides.diffuse_color[:, 4:], np.broadcast_to((0, 1, 0), (6, 4, 3)), atol=1e-6)
    np.testing.assert_allclose(hit_roughness(wall, guides), 0.25)


def test_materials_are_told_how_large_a_pixel_is(wall):
    materials = Striped(wall.triangles)
    cast_guides(wall, VIEW, materials=materials)
    pixel = BLUR * DISTANCE / FOCAL
    along_row, along_column = np.moveaxis(materials.steps[0], 1, 0)
    np.testing.assert_allclose(along_row, np.broadcast_to((pixel, 0, 0), along_row.shape), atol=0.03 * pixel)
    np.testing.assert_allclose(along_column, np.broadcast_to((0, 0, -pixel), along_column.shape),
                               atol=0.03 * pixel)


def test_further_samples_are_asked_for_only_where_the_picture_is_not_even(wall):
    materials = Striped(wall.triangles, edge=0.1)
    guides = cast_guides(wall, VIEW, SPREAD, materials)
    first, *others = materials.asked
    assert len(first) == 48 and len(others) == len(SPREAD) - 1
    for points in others:  # those of the two columns beside the edge
        assert len(points) == 12 and np.abs(points[:, 0] - 0.1).max() < 2 * DISTANCE / FOCAL
    mixed = (guides.diffuse_color[..., :2].min(axis=-1) > 0).any(axis=0)
    assert mixed[4] and mixed.sum() == 1
    np.testing.assert_allclose(guides.diffuse_color.sum(-1), 1, atol=1e-6)


def test_tiles_are_shown_where_materials_know_nothing(wall):
    guides = cast_guides(wall, VIEW, materials=Striped(wall.triangles, edge=9, knows_one=True))
    of_tile = guides.hit_triangle == 1
    assert of_tile.any() and not of_tile.all()
    np.testing.assert_allclose(guides.diffuse_color[of_tile], TILE)
    np.testing.assert_allclose(guides.material[of_tile][:, :3], TILE)
    np.testing.assert_allclose(guides.diffuse_color[~of_tile], np.broadcast_to((1, 0, 0), (np.sum(~of_tile), 3)))


def test_bent_normals_never_point_away_from_the_camera(wall):
    away = np.float32((0.6, 0.8, 0))
    guides = cast_guides(wall, VIEW, materials=Striped(wall.triangles, normal=away))
    rays = guides.position / np.linalg.norm(guides.position, axis=-1, keepdims=True)
    assert ((guides.normal * rays).sum(-1) < 0).all()
    np.testing.assert_allclose(np.linalg.norm(guides.normal, axis=-1), 1, rtol=1e-5)
