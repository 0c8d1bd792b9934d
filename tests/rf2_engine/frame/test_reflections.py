# SPDX-License-Identifier: GPL-3.0-or-later
"""What mirrors and glass show is known where Cycles shows it."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.light.specular import ends
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun
from tests.rf2_engine.rooms import assert_alike, beside_cycles

RED = (0.8, 0.05, 0.05)
WALL = [(-3, 2, -3), (3, 2, -3), (3, 2, 3), (-3, 2, 3)]


@pytest.fixture
def guides(monkeypatch):
    """Those of every picture that is rendered."""
    seen = []

    def spy(*given):
        seen.append(ends.add_path_ends(*given))
        return seen[-1]

    monkeypatch.setattr(first_hits, "add_path_ends", spy)
    return seen


def smooth(name: str, **inputs):
    made = material(name, (1, 1, 1))
    for key, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[key.replace("_", " ")].default_value = value
    return made


def test_what_a_mirror_shows_is_where_cycles_shows_it(scene, tmp_path, guides, monkeypatch):
    mesh_object(scene, "Mirror", WALL, [(0, 1, 2, 3)], smooth("Mirror", Metallic=1.0, Roughness=0.0))
    cube(scene, location=(0, -9, 0), of=material("Red", RED))  # behind the camera
    sun(scene, (-1.3, 0, 0))
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    color = guides[0].reflected_color.astype(np.float32)
    shown, red = color.max(-1) > 0, picture[..., 0] > 3 * picture[..., 1]
    assert 10 < shown.sum() < 0.5 * shown.size and (shown == red).mean() > 0.97
    np.testing.assert_allclose(color[shown], np.tile(RED, (shown.sum(), 1)), rtol=0.05, atol=0.02)
    assert guides[0].reflected_position[shown, 1].max() < -7.9 and guides[0].refracted_color is None
    np.testing.assert_allclose(guides[0].reflected_normal[shown][:, 1].astype(float), 1, atol=1e-2)

    monkeypatch.setattr(ends, "PATHS", shown.size // 8)  # a large picture is looked at in part
    press_f12(scene, tmp_path)
    coarse = guides[1].reflected_color.max(-1) > 0
    assert not (coarse == shown).all() and (coarse == shown).mean() > 0.9


def test_glass_shows_the_wall_behind_it_and_a_matte_scene_nothing(scene, tmp_path, guides):
    pane = mesh_object(scene, "Pane", [(x / 4, -1, z / 4) for x, _, z in WALL], [(0, 1, 2, 3)],
                       smooth("Glass", Transmission_Weight=1.0, Roughness=0.0, IOR=1.0))
    mesh_object(scene, "Wall", WALL, [(0, 1, 2, 3)], material("Red", RED))
    sun(scene, (1.3, 0, 0))
    press_f12(scene, tmp_path)
    shown = guides[0].refracted_color.max(-1) > 0
    assert shown.any() and (np.abs(guides[0].refracted_position[shown, 1] - 2) < 1e-2).all()
    bpy.data.objects.remove(pane)
    press_f12(scene, tmp_path)
    assert guides[1].refracted_color is None and guides[1].reflected_color is None


def test_a_simplified_ball_of_glass_shows_what_the_fine_one_shows(scene, tmp_path, guides):
    """A red cube before a wall, upside down."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=1)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(smooth("Glass", Transmission_Weight=1.0, Roughness=0.0, IOR=1.5))
    mesh_object(scene, "Wall", [(2 * x, 6, 2 * z) for x, _, z in WALL], [(0, 1, 2, 3)], material("White", (0.8,) * 3))
    cube(scene, location=(0, 4, 0), of=material("Red", RED))
    sun(scene, (1.3, 0, 0))
    for budget in (8192, 512):
        scene.renderformer_v2.token_budget = budget
        press_f12(scene, tmp_path)
    fine, coarse = (seen.refracted_color.astype(np.float32) for seen in guides)
    red = [color[..., 0] > 3 * color[..., 1] for color in (fine, coarse)]
    assert 20 < red[0].sum() < 0.9 * (fine.max(-1) > 0).sum()
    assert (red[0] != red[1]).sum() < 0.12 * red[0].sum()


@pytest.mark.parametrize(("shown_by", "metallic"), [
    ({"Metallic": 1.0, "Roughness": 0.0}, 0), ({"Transmission_Weight": 1.0, "Roughness": 0.0, "IOR": 1.5}, 0),
    ({"Transmission_Weight": 1.0, "Roughness": 0.0, "IOR": 1.5}, 1)])
def test_gloss_in_a_mirror_and_behind_glass_shows_the_sky_as_in_cycles(scene, tmp_path, shown_by, metallic):
    """A black floor with a layer, or one of rough metal."""
    mesh_object(scene, "Pane", [(x, 0, z) for x, _, z in WALL] + [(x, 0.1, z) for x, _, z in WALL], [
        (0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)], smooth("Pane", **shown_by))
    floor = smooth("Floor", Base_Color=(0.8 * metallic,) * 3 + (1,), Metallic=float(metallic),
                   Roughness=0.6 if metallic else 0.1)
    mesh_object(scene, "Floor", [(-20, -20, -1), (20, -20, -1), (20, 20, -1), (-20, 20, -1)], [(0, 1, 2, 3)], floor)
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    scene.renderformer_v2.light = "NETWORK"
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)
