# SPDX-License-Identifier: GPL-3.0-or-later
"""More meshes that shine than Max Triangles holds, such as fairy lights."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.geometry import area_vectors, surfaces
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting import instances
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes.reduce import COARSEST

COUNT, FACES = 100, 80
RADIUS = 0.02


@pytest.fixture
def bulbs(scene, add_material):
    """Function that hangs bulbs of a strength in a row along X; linked: they share a mesh."""
    def add(count=COUNT, strength=20.0, linked=True, name="Bulb"):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=RADIUS, location=(-3, 0, 3))
        bulb = bpy.context.object
        bulb.name = name
        bulb.data.materials.append(add_material(name, (0, 0, 0), emission=strength))
        for i in range(1, count):
            copy = bpy.data.objects.new(f"{name} {i}", bulb.data if linked else bulb.data.copy())
            copy.location = (-3 + 6 * i / (count - 1), 0, 3)
            scene.collection.objects.link(copy)
        return bulb
    return add


def surroundings():
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.4, location=(0, 0, 0.4))


def flux(scene) -> np.ndarray:
    """(3,) of all tokens, over pi."""
    return (scene.emission * meshes.areas(scene.triangles)[:, None]).sum(axis=0)


@pytest.mark.parametrize("seen", [False, True])
@pytest.mark.parametrize("linked", [True, False])
def test_many_bulbs_leave_room_for_all_else_and_give_as_much_light(bulbs, converted, report, seen, linked):
    surroundings(), bulbs(linked=linked)
    full, scene = converted(seen=seen), converted(token_budget=512, seen=seen)
    lowest = scene.triangles[..., 2].max(axis=1)
    assert len(scene) <= 512 and (lowest == 0).any() and ((lowest > 0) & (lowest < 1)).sum() >= 8
    assert not [remark for remark in report.entries if remark.kind == "unplaced"]
    np.testing.assert_allclose(flux(scene), flux(full), rtol=1e-3)
    np.testing.assert_allclose(scene.emission.max(), 20, rtol=0.5)  # more where coarse shapes have less area


def test_what_the_network_gets_of_many_bulbs_is_spread_evenly(bulbs, converted):
    surroundings(), bulbs()
    scene = converted(token_budget=512, seen=True)
    shining = scene.triangles[scene.is_light]
    bulb = surfaces(shining, np.zeros((len(shining), 1)))
    x = np.sort(np.bincount(bulb, shining.mean(axis=1)[:, 0]) / np.bincount(bulb))
    assert 15 <= len(x) <= 512 * instances.DETAIL * instances.SHINING / COARSEST
    assert np.diff(x).max() < 0.8 and x.min() < -2.5 and x.max() > 2.5


@pytest.mark.parametrize("linked", [True, False])
def test_rays_meet_all_of_many_bulbs_as_they_are(bulbs, converted, linked):
    surroundings(), bulbs(linked=linked)
    geometry = converted(token_budget=512).geometry
    bulb = geometry.triangles[geometry.triangles[..., 2].min(axis=1) > 1]
    assert len(bulb) == COUNT * FACES
    places = np.linspace(-3, 3, COUNT)
    near = np.abs(bulb.mean(axis=1)[:, :1] - places).min(axis=1)
    assert near.max() <= RADIUS
    areas = np.linalg.norm(area_vectors(bulb), axis=1)
    np.testing.assert_allclose(areas.sum() / COUNT, 4 * np.pi * RADIUS ** 2, rtol=0.1)


def test_bulbs_for_which_there_is_room_stay_as_they_are(bulbs, converted, report):
    surroundings(), bulbs(count=10)
    scene = converted(token_budget=512)
    size = np.abs(scene.triangles[scene.is_light] - (0, 0, 3))[..., 1:].max()
    assert size < 1.1 * RADIUS and not [line for line in report.lines() if "enlarged" in line]


def test_a_bright_lamp_is_kept_among_many_dim_ones_of_its_size(bulbs, converted):
    surroundings(), bulbs(strength=2.0)
    bulbs(count=1, strength=5000.0, name="Lamp").location = (0.03, 0, 2.9)
    scene = converted(token_budget=512)
    lamp = scene.triangles[scene.emission.max(axis=1) > 1000]
    assert len(lamp) >= 8
    np.testing.assert_allclose(lamp.mean(axis=(0, 1)), (0.03, 0, 2.9), atol=0.01)
    np.testing.assert_allclose(flux(scene), flux(converted()), rtol=1e-3)


def test_remarks_name_what_shines_where_it_takes_the_room_of_other_things(bulbs, converted, report):
    surroundings(), bulbs()
    for i in range(60):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.1 + 0.01 * i, location=(i, 5, 0))
    scene = converted(token_budget=512)
    assert scene.is_light.any()
    (bulb,) = [line for line in report.lines() if "enlarged to shine as much" in line]
    assert bulb.startswith("approximated Bulb: ") and "let fewer shine" in bulb
    joined = [remark.message for remark in report.entries if "a sample of such things" in remark.message]
    assert joined and all("fewer instances of Bulb shine" in message for message in joined)


def test_each_mesh_keeps_an_instance_before_others_keep_a_second_one(scene, converted, report):
    """A forest that fills the picture does not take the place of the stone behind it."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, location=(0, 0, 0))
    tree = bpy.context.object
    for i in range(1, 100):
        copy = bpy.data.objects.new(f"Tree {i}", tree.data)
        copy.location = (i % 10 - 5, i // 10, 0)
        scene.collection.objects.link(copy)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.2, location=(0, 60, 0))
    found = converted(token_budget=512, seen=True)
    assert (found.triangles[..., 1].min(axis=1) > 50).any()
    assert not [remark for remark in report.entries if remark.kind == "unplaced"]
