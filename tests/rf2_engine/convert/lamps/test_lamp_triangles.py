# SPDX-License-Identifier: GPL-3.0-or-later
"""Brightness of every lamp type against Cycles, by integrating the converted triangles numerically."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import LampInstance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.lamp_triangles import COARSE, FINE, convert_light
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.placed_lamp import BoundingSphere
from mathutils import Matrix
from mathutils.bvhtree import BVHTree

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, lamp
from tests.rf2_engine.convert.token_light import integrated

POSE = Matrix.Translation((0.3, -0.2, 2.5)) @ Matrix.Rotation(0.4, 4, "X") @ Matrix.Rotation(0.3, 4, "Y")
POINTS = [((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), ((-1.0, -0.3, 0.2), (0.3, 0.1, 1.0))]
LAMPS = {
    "square": dict(kind="AREA", energy=100, size=1.0),
    "rectangle": dict(kind="AREA", energy=100, shape="RECTANGLE", size=1.5, size_y=0.3, color=(1, 0.5, 0.2)),
    "ellipse": dict(kind="AREA", energy=100, shape="ELLIPSE", size=1.5, size_y=0.5),
    "disk by radiance": dict(kind="AREA", energy=100, shape="DISK", size=0.5, normalize=False),
    "point": dict(kind="POINT", energy=100, shadow_soft_size=0.1, exposure=1.0),
    "point of radius 0": dict(kind="POINT", energy=100, shadow_soft_size=0.0),
    "point by radiance": dict(kind="POINT", energy=100, shadow_soft_size=0.3, normalize=False),
    "warm point": dict(kind="POINT", energy=100, use_temperature=True, temperature=3000),
    "spot": dict(kind="SPOT", energy=100, spot_size=1.6, spot_blend=0.9, shadow_soft_size=0.05),
    "hard spot": dict(kind="SPOT", energy=100, spot_size=1.2, spot_blend=0.0, shadow_soft_size=0.05),
    "spot by radiance": dict(kind="SPOT", energy=100, spot_size=1.4, spot_blend=0.5, shadow_soft_size=0.2,
                             normalize=False, exposure=-1.0),
    "large point": dict(kind="POINT", energy=100, shadow_soft_size=0.8, use_temperature=True, temperature=9000),
    "large point of soft falloff": dict(kind="POINT", energy=100, shadow_soft_size=0.8, use_soft_falloff=True),
    "large spot of hard falloff": dict(kind="SPOT", energy=100, spot_size=1.6, shadow_soft_size=0.5,
                                       use_soft_falloff=False),
    "cold ellipse by radiance": dict(kind="AREA", energy=100, shape="ELLIPSE", size=0.8, size_y=0.4, normalize=False,
                                     use_temperature=True, temperature=12000, exposure=2.0),
    "sun": dict(kind="SUN", energy=3, angle=0.01),
    "warm sun": dict(kind="SUN", energy=3, angle=0.2, exposure=1.5, use_temperature=True, temperature=2500),
    "sun of no size by radiance": dict(kind="SUN", energy=3, angle=0.0, normalize=False),
    "wide sun": dict(kind="SUN", energy=3, angle=0.3, normalize=False),
}


def converted(obj, report=None, detail=FINE):
    scene = convert_light(LampInstance(obj.name, np.array(obj.matrix_world, np.float64), copied(obj.data)),
                          BoundingSphere(np.zeros(3), 1.0), report or Report(), detail)
    scene.validate()
    return scene


@pytest.mark.parametrize("settings", LAMPS.values(), ids=LAMPS)
@pytest.mark.parametrize("scale", [1.0, 1.7])
def test_lamp_is_as_bright_as_in_cycles(settings, scale):
    empty_cycles_scene()
    obj = lamp(matrix=POSE @ Matrix.Scale(scale, 4), **settings)
    for point, normal in POINTS:
        expected = irradiance(point, normal)
        assert expected.min() > 0
        np.testing.assert_allclose(integrated(converted(obj), point, normal), expected, rtol=0.05)
        coarse = converted(obj, detail=COARSE)
        np.testing.assert_allclose(integrated(coarse, point, normal), expected, rtol=0.2)
        assert len(coarse) <= 20 and len(coarse) < len(converted(obj)) or obj.data.type == "AREA"


@pytest.mark.parametrize("kind", ["POINT", "SPOT"])
def test_estimates_know_what_soft_falloff_takes_from_the_emission(kind):
    empty_cycles_scene()
    hard, soft = (converted(lamp(kind, POSE, energy=100, shadow_soft_size=0.8, use_soft_falloff=is_soft))
                  for is_soft in (False, True))
    factor = soft.seldom("softened")[soft.is_light, None]
    assert (hard.seldom("softened") == 1).all() and (factor < 1).all()
    np.testing.assert_allclose(soft.emission[soft.is_light] / factor, hard.emission[hard.is_light], rtol=1e-5)


def test_a_lamp_of_infinite_strength_gives_no_light_as_in_cycles():
    empty_cycles_scene()
    report = Report()
    assert not len(converted(lamp("POINT", POSE, energy=float("inf")), report))
    assert any("its strength has values that are infinite" in line for line in report.lines())


@pytest.mark.parametrize("angle", [0.3, 0.45, 0.55, 0.65])
@pytest.mark.parametrize("scale", [(1, 1, 1), (1.5, 1.5, 1)])
def test_spot_cone_and_blend_follow_cycles(angle, scale):
    empty_cycles_scene()
    pose = Matrix.Translation((0, 0, 5)) @ Matrix.Diagonal((*scale, 1))
    obj = lamp("SPOT", pose, energy=500, spot_size=1.2, spot_blend=0.4, shadow_soft_size=0.02)
    point = (5 * np.tan(angle), 0, 0)
    expected = irradiance(point, (0, 0, 1))
    np.testing.assert_allclose(integrated(converted(obj), point, (0, 0, 1)), expected, rtol=0.06, atol=0.03)


@pytest.mark.parametrize("spread", [0.6, 2.0])
def test_area_spread_is_that_of_cycles(spread):
    empty_cycles_scene()
    obj = lamp("AREA", Matrix.Translation((0, 0, 2.5)), energy=100, size=0.3, spread=spread)
    for angle in (0.0, 0.1, 0.25, 0.6):
        point = (2.5 * np.tan(angle), 0, 0)
        np.testing.assert_allclose(integrated(converted(obj), point, (0, 0, 1)), irradiance(point, (0, 0, 1)),
                                   rtol=0.02, atol=1e-3)


def test_area_lamp_without_spread_is_a_beam_as_wide_as_the_lamp():
    empty_cycles_scene()
    obj = lamp("AREA", Matrix.Translation((0, 0, 10)), energy=100, size=0.5, spread=0.0)
    for x in (0.0, 1.0):
        found, expected = integrated(converted(obj), (x, 0, 0), (0, 0, 1), 40), irradiance((x, 0, 0), (0, 0, 1))
        np.testing.assert_allclose(found, expected, rtol=0.1)


@pytest.mark.parametrize("kind, scale", [
    ("AREA", (0, 0, 0)), ("AREA", (0, 1, 1)), ("AREA", (1, 1, 0)), ("POINT", (0, 0, 0)), ("SPOT", (0, 0, 0)),
    ("SPOT", (1, 0, 1)), ("SPOT", (1, 1, 0)), ("SUN", (0, 0, 0)), ("SUN", (0, 1, 1)), ("SUN", (1, 1, 0))])
def test_scale_of_zero_is_as_in_cycles(kind, scale):
    empty_cycles_scene()
    obj, report = lamp(kind, Matrix(), energy=100), Report()
    obj.location, obj.rotation_euler, obj.scale = (0.3, -0.2, 2.5), (0.4, 0.3, 0), scale
    bpy.context.view_layer.update()
    point, normal = POINTS[0]
    expected = irradiance(point, normal)
    np.testing.assert_allclose(integrated(converted(obj, report), point, normal), expected, rtol=0.05)
    assert ("skipped", "Lamp") in [entry[:2] for entry in report.entries] or expected.any()


@pytest.mark.parametrize("kind", ["AREA", "SUN"])
def test_nothing_leaves_through_the_back(kind):
    empty_cycles_scene()
    scene = converted(lamp(kind, Matrix.Translation((0, 0, 2))))
    above, down = (0.1, 0.2, 80.0), (0.0, 0.0, -1.0)
    assert not integrated(scene, above, down).any()
    lit = scene.is_light
    face = np.cross(scene.triangles[:, 1] - scene.triangles[:, 0], scene.triangles[:, 2] - scene.triangles[:, 0])
    assert (face[lit] @ [0, 0, -1] > 0).all()
    assert (np.einsum("nc,nkc->nk", face, scene.normals) > 0).all()
    np.testing.assert_allclose(scene.beam_axis[lit], [[0, 0, -1]] * lit.sum(), atol=1e-6)


def test_mirrored_and_sheared_objects_keep_the_flux_of_an_area_lamp():
    empty_cycles_scene()
    obj = lamp("AREA", POSE @ Matrix.Diagonal((-1.5, 1, 1, 1)), energy=100, size=0.6)
    point, normal = POINTS[1]
    np.testing.assert_allclose(integrated(converted(obj), point, normal), irradiance(point, normal), rtol=0.05)


def test_shade_of_a_spot_is_open_along_the_beam_only():
    empty_cycles_scene()
    scene = converted(lamp("SPOT", Matrix(), energy=100, spot_size=1.0, shadow_soft_size=0.05))
    shade = scene.triangles[~scene.is_light]
    tree = BVHTree.FromPolygons([tuple(p) for p in shade.reshape(-1, 3)],
                                [tuple(range(3 * i, 3 * i + 3)) for i in range(len(shade))])

    def blocked(angle):
        return tree.ray_cast((0, 0, 0), (np.sin(angle), 0, -np.cos(angle)))[0] is not None

    assert [blocked(a) for a in (0.0, 0.45, 0.6, 1.5, 3.1)] == [False, False, True, True, True]


def test_in_a_wide_place_a_lamp_is_still_as_small_as_its_housing():
    empty_cycles_scene()
    obj, report = lamp("POINT", Matrix(), energy=100, shadow_soft_size=0.1), Report()
    scene = convert_light(LampInstance(obj.name, np.eye(4), copied(obj.data)), BoundingSphere(np.zeros(3), 50.0),
                          report)
    assert np.linalg.norm(scene.triangles, axis=-1).max() < 0.15 and not report.entries


def test_what_a_lamp_loses_is_reported():
    empty_cycles_scene()
    report = Report()
    portal = lamp("AREA", POSE)
    portal.data.cycles.is_portal = True
    assert len(converted(portal, report)) == 0 and not report.entries
    converted(lamp("POINT", POSE, shadow_soft_size=0.0), report)
    converted(lamp("SUN", POSE, angle=0.0), report)
    assert [kind for kind, _, _ in report.entries] == ["approximated"] * 2
    assert all("estimated" in message for _, _, message in report.entries)
