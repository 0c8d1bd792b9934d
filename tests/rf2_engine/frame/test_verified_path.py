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
import torch
from torch.nn import functional as F

from bl_ext.user_default.renderformer_v2.model.camera import square_view
from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.model.network.inputs import view_inputs
from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb
from bl_ext.user_default.renderformer_v2.model.published.h5 import read_h5
from bl_ext.user_default.renderformer_v2.model.renderer import Renderer
from bl_ext.user_default.renderformer_v2.model.tensor_group import stacked
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
FAR = 100.0                    # metres, beyond all surfaces
SAME = 38.0                    # dB, of pictures that differ in how edges are sampled
LIKE = 26.0                    # dB, of pictures that differ in their bundles of rays, too


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
    """(H, W, 3) as a screen shows it."""
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    (layer,) = last_render.last_frame
    assert not layer.error and layer.weights == str(COMMITTED)
    return linear_to_srgb(picture[..., :3])


def test_f12_shows_an_unseen_room(unseen, tmp_path):
    reference = unseen.renderformer_v2.reference
    reference.use, reference.samples, reference.use_denoising = True, 64, True
    found = press_f12(unseen, tmp_path)
    ours, cycles = (found[f"ViewLayer.{name}"][..., :3] for name in ("Combined", "Cycles Reference"))
    score, of_grey = (psnr(linear_to_srgb(x), linear_to_srgb(cycles)) for x in (ours, grey(cycles)))
    assert score >= LEAST and score >= of_grey + ABOVE_GREY, f"{score:.2f} dB, grey {of_grey:.2f} dB"


def test_an_h5_scene_of_it_is_drawn_as_f12_draws_it(unseen, tmp_path):
    found = press_f12(unseen, tmp_path)
    expected = found["ViewLayer.Combined"][..., :3]
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "room.h5")) == {"FINISHED"}
    scene = read_h5(tmp_path / "room.h5")
    pipeline = Renderer(COMMITTED, device="cpu", precision="fp32").pipeline
    (drawn,) = pipeline.render_processed(scene, example_room.RESOLUTION) / scene.metadata["normalization"]["exposure"]
    surfaces = found["ViewLayer.Depth"][..., 0] < FAR
    assert surfaces.mean() > 0.8
    assert psnr(linear_to_srgb(drawn)[surfaces][None], linear_to_srgb(expected)[surfaces][None]) > SAME


def test_views_of_a_batch_are_drawn_as_single_ones(unseen, tmp_path):
    for name in ("a.h5", "b.h5"):
        assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / name)) == {"FINISHED"}
        unseen.camera.location.x += 0.5
    first, second = (read_h5(tmp_path / name) for name in ("a.h5", "b.h5"))
    inputs = views_of(first), views_of(second)
    pipeline = Renderer(COMMITTED, device="cpu", precision="fp32").pipeline
    network = pipeline.load("transformer_512")
    with torch.no_grad():
        context = network.encode_scene(pipeline.encoder.inputs(first))
        both = network.render_view(context, stacked(inputs))
        single = torch.cat([network.render_view(context, view) for view in inputs])
    torch.testing.assert_close(both, single, rtol=1e-4, atol=1e-4)
    assert (single[0] - single[1]).abs().mean() > 0.01, "the camera has moved"


def views_of(scene):
    view = square_view(scene.camera_to_world[0], scene.fov[0], example_room.RESOLUTION)
    return view_inputs(view)


def test_a_prepared_frame_of_it_is_drawn_as_f12_draws_it(unseen, tmp_path):
    expected = render(unseen, tmp_path)
    export_frame(unseen, tmp_path / "frame", Report())
    imported = prepare(import_frame(tmp_path / "frame", Report(), example_room.RESOLUTION))
    imported.renderformer_v2.as_is = False  # which a frame of the paper's would not be
    bpy.context.window.scene = imported
    assert psnr(render(imported, tmp_path), expected) > LIKE


def test_a_lens_of_nearly_no_size_draws_the_sharp_picture(unseen, tmp_path):
    expected, lens = render(unseen, tmp_path), unseen.camera.data.dof
    lens.use_dof, lens.aperture_fstop, lens.focus_distance, unseen.renderformer_v2.lens_samples = True, 64, 7, 2
    assert psnr(render(unseen, tmp_path), expected) > SAME


def test_the_face_of_a_cube_is_the_single_picture_of_its_angle(unseen, tmp_path):
    """A panorama of 90 degrees as the middle face, and a camera of 90 degrees."""
    data, size = unseen.camera.data, unseen.render
    data.angle = math.pi / 2
    size.resolution_x = size.resolution_y = 128  # about as fine as what panoramas are made of
    single = render(unseen, tmp_path)
    data.type, data.panorama_type = "PANO", "EQUIANGULAR_CUBEMAP_FACE"
    size.resolution_x = size.resolution_y = 64
    panorama = render(unseen, tmp_path)
    across = np.tan((np.arange(64) + 0.5 - 32) / 32 * math.pi / 4)  # its pixels in the single picture, -1 to 1
    places = torch.from_numpy(np.stack(np.meshgrid(across, across), axis=-1))[None].float()
    expected = F.grid_sample(torch.from_numpy(single).movedim(-1, 0)[None].float(), places, align_corners=False)
    expected = expected[0].movedim(0, -1).numpy()
    assert psnr(expected, panorama) > max(LIKE, psnr(expected[:, ::-1], panorama) + 2)
