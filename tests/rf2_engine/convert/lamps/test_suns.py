# SPDX-License-Identifier: GPL-3.0-or-later
"""Suns of skies and HDRIs as lights: nothing is lost, and Cycles sees the same irradiance."""
from pathlib import Path

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.suns import split_suns
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.world import convert_world

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance
from tests.rf2_engine.convert.token_light import gathered, integrated
from tests.rf2_engine.convert.worlds import image_world, sky_world

STUDIO_LIGHTS = Path(bpy.utils.system_resource("DATAFILES"), "studiolights", "world")
NORMALS = (0, 0, 1), (1, 0.2, 0.3), (-0.4, 1, 0.2)


def light(scene, normal):
    """(3,) irradiance of tokens and panorama at the middle of an empty scene."""
    return integrated(scene, (0, 0, 0), normal) + gathered(scene.environment, normal)


@pytest.mark.parametrize("elevation, size", [(0.05, 0.01), (0.7, 0.15)])
def test_the_sun_of_a_sky_becomes_a_light_and_nothing_is_lost(converted, report, elevation, size):
    made = sky_world(elevation, disc=True, size=size)
    scene, whole = converted(), convert_world(copied(made), Report())
    assert scene.is_light.any() and scene.environment.max() < whole.max() / 8
    toward = scene.triangles.mean(axis=(0, 1)) / np.linalg.norm(scene.triangles.mean(axis=(0, 1)))
    np.testing.assert_allclose(toward[2], np.sin(elevation), atol=0.01)
    np.testing.assert_allclose(np.arctan2(toward[0], toward[1]), 0.7, atol=0.01)
    for normal in NORMALS:
        np.testing.assert_allclose(light(scene, normal), gathered(whole, normal), rtol=0.02)
    assert any(name == made.name and "sun light" in message for _, name, message in report.entries)


def test_a_sky_without_its_sun_has_none(converted, report):
    sky_world(0.7, disc=False)
    assert len(converted()) == 0 and all("Sky Texture" in line for line in report.lines())


def test_light_of_an_hdri_with_a_sun_is_as_in_cycles(converted):
    empty_cycles_scene(samples=512)
    image_world(bpy.data.images.load(str(STUDIO_LIGHTS / "city.exr")))
    scene = converted()
    assert scene.is_light.any()
    for normal in NORMALS:
        np.testing.assert_allclose(light(scene, normal), irradiance((0, 0, 0), normal), rtol=0.02)


def test_what_is_wide_or_faint_stays_in_the_world():
    panorama = np.full((256, 512, 3), 0.5, np.float32)
    assert split_suns(panorama)[1] == []
    panorama[100:140, 200:260] = 50  # a window of 30 degrees
    panorama[200, 100] = 500         # a glint
    left, suns = split_suns(panorama)
    assert suns == []
    np.testing.assert_array_equal(left, panorama)
    panorama[50, 511] = 1e6          # across the seam
    left, (sun,) = split_suns(panorama)
    assert left.max() == 500 and np.allclose(left[50, 511], 0.5)


@pytest.mark.filterwarnings("error")
def test_light_too_faint_to_be_measured_is_no_sun():
    panorama = np.zeros((8, 16, 3), np.float32)
    panorama[2, 3] = 1e-44
    left, suns = split_suns(panorama)
    assert not suns and np.array_equal(left, panorama)
