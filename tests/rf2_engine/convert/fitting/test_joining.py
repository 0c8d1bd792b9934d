# SPDX-License-Identifier: GPL-3.0-or-later
"""More meshes than Max Triangles has coarse shapes for, as imported assemblies have: rays meet all of them."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.surface_kinds import Ray
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes

COUNT = 60
COLORS = (0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8)


@pytest.fixture
def balls(add_material):
    """Function that puts balls with meshes of their own in a row along X, in materials that take turns."""
    def add(materials):
        for i in range(COUNT):
            bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.4, location=(i, 0, 0.5))
            bpy.context.object.data.materials.append(materials[i % len(materials)])
            yield bpy.context.object
    return lambda materials: list(add(materials))


def columns_of(scene) -> np.ndarray:
    """(n,) which ball each real triangle is of."""
    return scene.surfaces.triangles.mean(axis=1)[:, 0].round().astype(int)


def test_rays_meet_all_meshes_where_they_are(balls, converted, add_material, report):
    balls([add_material(f"Colour {i}", color) for i, color in enumerate(COLORS)])
    full, scene = converted(), converted(token_budget=256)
    assert len(scene) <= 256 < len(full)
    assert sorted(np.bincount(columns_of(scene))) == sorted(np.bincount(columns_of(full))) == [80] * COUNT
    np.testing.assert_allclose(meshes.areas(scene.geometry.triangles).sum(), meshes.areas(full.triangles).sum(),
                               rtol=1e-5)
    assert not [remark for remark in report.entries if remark.kind == "unplaced"]
    assert [line for line in report.lines() if "a sample of such things" in line]


def test_their_tokens_have_their_materials(balls, converted, add_material):
    balls([add_material(f"Colour {i}", color) for i, color in enumerate(COLORS)])
    scene = converted(token_budget=256)
    shown = scene.tiles[scene.tile_index[scene.geometry.token], :3].mean(axis=(2, 3))
    np.testing.assert_allclose(shown, np.array(COLORS)[columns_of(scene) % len(COLORS)], atol=1e-2)


def test_more_materials_than_there_is_room_for_share_tokens(balls, converted, add_material):
    balls([add_material(f"Colour {i}", (i / COUNT,) * 3) for i in range(COUNT)])
    scene = converted(token_budget=256)
    assert len(scene) <= 256 and sorted(np.bincount(columns_of(scene))) == [80] * COUNT


def test_what_rays_tell_apart_is_not_joined(balls, converted, add_material):
    for i, ball in enumerate(balls([add_material("Grey", (0.5, 0.5, 0.5))])):
        ball.visible_camera = i % 2 == 0
    scene = converted(token_budget=256)
    is_hidden = (scene.hidden & Ray.CAMERA) > 0
    np.testing.assert_array_equal(is_hidden[scene.geometry.token], columns_of(scene) % 2 == 1)


def test_a_part_that_finds_no_room_even_so_is_named(balls, converted, add_material, report):
    for i, ball in enumerate(balls([add_material("Grey", (0.5, 0.5, 0.5))])):
        for bit, name in enumerate(("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")):
            setattr(ball, f"visible_{name}", not i >> bit & 1)
    converted(token_budget=256)
    unplaced = [remark for remark in report.entries if remark.kind == "unplaced"]
    assert 10 < len(unplaced) < COUNT and all("Max Triangles" in remark.message for remark in unplaced)
