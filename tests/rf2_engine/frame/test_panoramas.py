# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramic cameras: their pictures are those of Cycles as far as a perspective one is, and have no seams."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.camera import view_rays
from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.model.published import pipeline
from bl_ext.user_default.renderformer_v2.model.scene import View
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.model.published.bundles import tiny_published_config, write_bundle
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
    scene.camera.location, scene.camera.rotation_euler = (0.3, 0.2, -0.3), (1.5, 0.1, -2.44)
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


@pytest.mark.parametrize("kind, least", [("PERSP", 36), ("EQUIRECTANGULAR", 31), *(
    pytest.param(kind, 31, marks=pytest.mark.slow)
    for kind in ("MIRRORBALL", "FISHEYE_EQUISOLID", "CENTRAL_CYLINDRICAL"))])
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


def jump(picture):
    """How much more the columns differ where the sides of a picture meet than those around: 1 without a seam."""
    shown = np.sqrt(picture.clip(0))
    steps = np.abs(np.roll(shown, 1, axis=1) - shown).mean(axis=(0, 2))  # [0]: from the last column to the first
    return steps[0] / np.median(np.r_[steps[-8:], steps[1:9]])


@pytest.mark.parametrize("light", ["TRACED", pytest.param("NETWORK", marks=pytest.mark.slow)])
def test_the_sides_of_a_whole_turn_meet(room, tmp_path, monkeypatch, light):
    room.camera.data.panorama_type, room.renderformer_v2.light = "EQUIRECTANGULAR", light
    without_seam = jump(color(press_f12(room, tmp_path)))
    assert without_seam < 1.3
    monkeypatch.setattr(View, "wraps", False)
    assert jump(color(press_f12(room, tmp_path))) > 1.3 * without_seam


@pytest.mark.slow
def test_a_border_and_motion_blur_are_those_of_cycles_and_there_is_no_depth_of_field(room, tmp_path, monkeypatch):
    seen = []

    def make_guides(found, tokens, view, real=first_hits.make_guides):
        seen.append((found, view))
        return real(found, tokens, view)
    monkeypatch.setattr(first_hits, "make_guides", make_guides)
    settings, camera = room.render, room.camera
    camera.data.panorama_type, camera.data.dof.use_dof, room.renderformer_v2.lens_samples = "EQUIRECTANGULAR", True, 4
    settings.use_border, settings.border_min_x, settings.border_max_y = True, 0.23, 0.71
    settings.use_motion_blur, room.renderformer_v2.shutter_samples = True, 2
    for frame, x in ((1, 0.3), (2, 1)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    press_f12(room, tmp_path)
    stats, = last_render.last_frame
    assert not stats.error and [remark.message for remark in stats.remarks] == [
        "no depth of field: a panoramic camera has none"]
    assert len(seen) == 2 and seen[0][1].camera_to_world[0, 3] != seen[1][1].camera_to_world[0, 3]
    for found, view in seen:
        away = found["position"] - view.camera_to_world[:3, 3]
        rays = away / np.linalg.norm(away, axis=-1, keepdims=True)
        assert np.linalg.norm(rays - view_rays(view)[1], axis=-1).max() * view.longer_side / 2 < 0.02


def test_published_weights_render_the_faces_of_a_cube(room, tmp_path, monkeypatch):
    rendered = []

    def joined(view, faces, render, real=pipeline.join_faces):
        return real(view, faces, lambda face: rendered.append(face) or render(face))
    monkeypatch.setattr(pipeline, "join_faces", joined)
    settings = room.renderformer_v2
    settings.weights_source, settings.max_edge = "FOLDER", 1
    settings.weights_folder = str(write_bundle(tmp_path / "bundle", tiny_published_config()))
    room.camera.data.panorama_type = "EQUIRECTANGULAR"
    found = color(press_f12(room, tmp_path))
    assert not last_render.last_frame[0].error and len(rendered) == 6
    assert np.isfinite(found).all() and found.std() > 0
