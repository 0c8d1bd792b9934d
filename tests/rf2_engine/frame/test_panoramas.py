# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramic cameras: their pictures are those of Cycles as far as a perspective one is, and have no seams."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, material, press_f12

TYPES = {
    "EQUIRECTANGULAR": {},
    "CENTRAL_CYLINDRICAL": {},
    "EQUIANGULAR_CUBEMAP_FACE": {},
    "MIRRORBALL": {},
    "FISHEYE_EQUIDISTANT": {"fisheye_fov": 3.6},
    "FISHEYE_EQUISOLID": {},
    "FISHEYE_LENS_POLYNOMIAL": {},
}


@pytest.fixture
def room(scene):
    """A room with two boxes and a lamp around the camera."""
    walls = cube(scene, "Walls", of=material("White"))
    walls.scale = (4, 5, 2.5)
    for name, place, color in (("Red", (2, 2, -1.5), (0.8, 0.1, 0.1)), ("Green", (-2, -1.5, -1.2), (0.1, 0.6, 0.1)),
                               ("Blue", (0.5, -3.5, -1.4), (0.1, 0.2, 0.8))):
        cube(scene, name, place, material(name, color)).rotation_euler = (0, 0, 0.5)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.location, lamp.data.energy, lamp.data.size = (0.5, 1, 2.3), 250, 1.2
    scene.collection.objects.link(lamp)
    scene.camera.location, scene.camera.rotation_euler = (0.3, 0.2, -0.3), (1.5, 0.1, 0.4)
    scene.camera.data.type = "PANO"
    scene.render.resolution_x, scene.render.resolution_y = 128, 64
    scene.renderformer_v2.guide_samples, scene.renderformer_v2.max_edge = 8, 0.12
    return scene


def with_cycles(scene, tmp_path, samples=64):
    scene.render.engine, scene.cycles.samples = "CYCLES", samples
    scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = False, True
    found = press_f12(scene, tmp_path)
    scene.render.engine = "RENDERFORMER_V2"
    return found


def of_type(scene, kind):
    if kind == "PERSP":
        scene.camera.data.type, scene.camera.data.lens = "PERSP", 20
        return
    scene.camera.data.panorama_type = kind
    for name, value in TYPES[kind].items():
        setattr(scene.camera.data, name, value)


def color(passes):
    return passes["ViewLayer.Combined"][..., :3]


@pytest.mark.parametrize("kind, least", [("PERSP", 36), ("EQUIRECTANGULAR", 31), ("MIRRORBALL", 31),
                                         ("FISHEYE_EQUISOLID", 31), ("CENTRAL_CYLINDRICAL", 31)])
def test_pictures_are_those_of_cycles(room, tmp_path, kind, least):
    """A panorama of this size has about as many edges in it as twice as wide a picture."""
    of_type(room, kind)
    room.render.film_transparent = kind == "MIRRORBALL"
    found = press_f12(room, tmp_path)
    stats, = last_render.last_frame
    assert not stats.error and not stats.remarks
    expected = with_cycles(room, tmp_path)
    assert psnr(color(found), color(expected)) > least
    np.testing.assert_array_equal(found["ViewLayer.Combined"][..., 3], expected["ViewLayer.Combined"][..., 3])
    outside = (expected["ViewLayer.Combined"][..., :3] == 0).all(-1)
    assert outside.any() == (kind in ("MIRRORBALL", "FISHEYE_EQUISOLID"))
    assert not color(found)[outside].any()


def step(picture, before, after):
    """Mean difference between two columns, in display-like brightness."""
    shown = np.sqrt(picture.clip(0))
    return np.abs(shown[:, before] - shown[:, after]).mean()


def assert_no_seam(found, expected):
    """What is wrong with the picture does not jump where its sides meet more than elsewhere."""
    error = np.sqrt(found.clip(0)) - np.sqrt(expected.clip(0))
    jumps = np.abs(np.roll(error, 1, axis=1) - error).mean(axis=(0, 2))  # [0]: from the last column to the first
    assert jumps[0] < np.quantile(jumps, 0.9)


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_the_sides_of_a_whole_turn_meet(room, tmp_path, light):
    room.camera.data.panorama_type, room.renderformer_v2.light = "EQUIRECTANGULAR", light
    found = color(press_f12(room, tmp_path))
    assert_no_seam(found, color(with_cycles(room, tmp_path, 256)))


def test_dev(room, tmp_path):
    for light in ("TRACED", "NETWORK"):
        room.camera.data.panorama_type, room.renderformer_v2.light = "EQUIRECTANGULAR", light
        found = color(press_f12(room, tmp_path))
        expected = color(with_cycles(room, tmp_path, 256))
        error = np.sqrt(found.clip(0)) - np.sqrt(expected.clip(0))
        jumps = np.abs(np.roll(error, 1, axis=1) - error).mean(axis=(0, 2))
        print("DEV", light, jumps[0], np.quantile(jumps, [0, .25, .5, .75, .9, 1]), last_render.last_frame[0].seconds)
        j0 = np.abs(np.roll(found, 1, axis=1) - found).mean(axis=(0, 2))
        print("DEV own", j0[0], np.quantile(j0, [0, .25, .5, .75, .9, 1]))
