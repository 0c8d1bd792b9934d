# SPDX-License-Identifier: GPL-3.0-or-later
"""A trained network of the paper's architecture draws a room that it has not seen, on every way to the network.

The bundle in tests/fixtures/room_bundle is of the published format (docs/paper-training.md 5). A wrong unit, axis,
order of channels or exposure anywhere between Blender and the picture costs many decibels here; random weights would
not show it.
"""
import math

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb
from bl_ext.user_default.renderformer_v2.model.published.h5 import read_h5
from bl_ext.user_default.renderformer_v2.model.published.pipeline import PublishedPipeline
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.frame_export import export_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.frame_import import import_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import press_f12
from tools.datagen.scenes import example_room
from tools.verify_path.__main__ import HELD_OUT
from tools.verify_path.bundle import COMMITTED
from tools.verify_path.measure import grey

LEAST, ABOVE_GREY = 22.0, 6.0  # dB
SAME = 35.0                    # dB, of pictures that differ in how edges are sampled


@pytest.fixture
def unseen(scene):
    """A room that is not among those of the training, as tools.datagen makes it."""
    for old in list(scene.objects):
        bpy.data.objects.remove(old)
    setup = example_room.build(np.random.default_rng([HELD_OUT, 0, 0]), 1)
    scene.camera = setup.cameras[0]
    return prepare(scene)


def prepare(scene):
    settings = scene.renderformer_v2
    settings.weights_source, settings.weights_folder, settings.precision = "FOLDER", str(COMMITTED), "fp32"
    settings.token_budget, settings.max_edge, settings.guide_samples = example_room.TRIANGLES, 0.25, 8
    scene.render.resolution_x = scene.render.resolution_y = example_room.RESOLUTION
    return scene


def render(scene, tmp_path) -> np.ndarray:
    """(64, 64, 3) as a screen shows it."""
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    (layer,) = last_render.last_frame
    assert not layer.error and layer.weights == str(COMMITTED)
    return linear_to_srgb(picture[..., :3])


def test_f12_shows_an_unseen_room(unseen, tmp_path):
    reference = unseen.renderformer_v2.reference
    reference.use, reference.samples, reference.use_denoising = True, 128, True
    found = press_f12(unseen, tmp_path)
    ours, cycles = (found[f"ViewLayer.{name}"][..., :3] for name in ("Combined", "Cycles Reference"))
    score, of_grey = (psnr(linear_to_srgb(x), linear_to_srgb(cycles)) for x in (ours, grey(cycles)))
    assert score >= LEAST and score >= of_grey + ABOVE_GREY, f"{score:.2f} dB, grey {of_grey:.2f} dB"


def test_an_h5_scene_of_it_is_drawn_as_f12_draws_it(unseen, tmp_path):
    expected = press_f12(unseen, tmp_path)["ViewLayer.Combined"]
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "room.h5")) == {"FINISHED"}
    scene = read_h5(tmp_path / "room.h5")
    (drawn,) = PublishedPipeline(COMMITTED, "cpu", None).render_processed(scene, example_room.RESOLUTION)
    drawn = drawn / scene.metadata["normalization"]["exposure"]
    surfaces = press_f12(unseen, tmp_path)["ViewLayer.Depth"][..., 0] < 100
    assert surfaces.mean() > 0.8
    assert psnr(linear_to_srgb(drawn)[surfaces], linear_to_srgb(expected[..., :3])[surfaces]) > SAME


def test_a_prepared_frame_of_it_is_drawn_as_f12_draws_it(unseen, tmp_path):
    expected = render(unseen, tmp_path)
    export_frame(unseen, tmp_path / "frame", Report())
    imported = prepare(import_frame(tmp_path / "frame", Report(), example_room.RESOLUTION))
    imported.renderformer_v2.as_is = False  # which a frame of the paper's would not be
    bpy.context.window.scene = imported
    assert psnr(render(imported, tmp_path), expected) > LEAST


def test_a_lens_of_nearly_no_size_draws_the_sharp_picture(unseen, tmp_path):
    expected, lens = render(unseen, tmp_path), unseen.camera.data.dof
    lens.use_dof, lens.aperture_fstop, lens.focus_distance, unseen.renderformer_v2.lens_samples = True, 64, 7, 2
    assert psnr(render(unseen, tmp_path), expected) > SAME


def test_the_face_of_a_cube_is_the_single_picture_of_its_angle(unseen, tmp_path):
    """A panorama of 90 degrees as the middle face, and a camera of 90 degrees."""
    data = unseen.camera.data
    data.angle = math.pi / 2
    single = render(unseen, tmp_path)
    data.type, data.panorama_type = "PANO", "EQUIANGULAR_CUBEMAP_FACE"
    panorama = render(unseen, tmp_path)
    middle = slice(24, 40)  # where both projections are nearly the same, but for the scale
    scale = math.pi / 4     # pixels of the panorama that a pixel of the single picture is wide there
    places = np.round(31.5 + (np.arange(24, 40) - 31.5) / scale).astype(int)
    assert psnr(single[middle, middle], panorama[np.ix_(places, places)]) > LEAST
