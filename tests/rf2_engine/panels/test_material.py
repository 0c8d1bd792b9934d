# SPDX-License-Identifier: GPL-3.0-or-later
"""Latents of materials: numbers from a file, a sphere through the autoencoder and back, and a small picture."""
import json

import bpy
import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.model.material import measured_latent
from bl_ext.user_default.renderformer_v2.model.material.autoencoder import MaterialAutoencoder
from bl_ext.user_default.renderformer_v2.model.material.measured import SHAPE, MeasuredBRDF
from bl_ext.user_default.renderformer_v2.model.weights.checkpoint import load_component
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import material as material_panel
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.files import write_panorama
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import published_weights

from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine import f12
from tests.sources import ROOT

ROOM = ROOT / "tests" / "fixtures" / "room_bundle"
LATENT = np.linspace(-0.9, 0.9, 9).astype(np.float32)


@pytest.fixture
def material(scene):
    return f12.material("Measured")


@pytest.fixture
def bundle(tmp_path, monkeypatch):
    """A folder with an autoencoder of the real sizes but narrow, with random weights."""
    folder = tmp_path / "renderformer-v2" / "material_autoencoder"
    folder.mkdir(parents=True)
    torch.manual_seed(0)
    save_file(MaterialAutoencoder().state_dict(), folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps({"latent_dim": 9, "image_channels": 3, "image_size": 256}))
    (folder / "preprocessor_config.json").write_text(json.dumps({"mode": "log10_1p"}))
    monkeypatch.setattr(published_weights, "bundle_folder", lambda: folder.parent)
    return folder.parent


def load(material, file):
    with bpy.context.temp_override(material=material):
        return bpy.ops.renderformer_v2.load_latent(filepath=str(file))


def test_nine_numbers_of_a_file_become_the_latent(material, tmp_path):
    np.save(tmp_path / "latent.npy", LATENT[None])
    assert load(material, tmp_path / "latent.npy") == {"FINISHED"}
    assert material.renderformer_v2.use_latent
    np.testing.assert_allclose(material.renderformer_v2.latent, LATENT, atol=1e-6)


@pytest.mark.parametrize("numbers, message", [
    (np.zeros(8), "expected 9 numbers"), (np.full(9, 2.0), "from -1 to 1"), (np.array(["a"] * 9), "expected 9 numbers"),
    (np.full(9, np.nan), "expected 9 numbers")])
def test_what_is_no_latent_is_said_and_changes_nothing(material, tmp_path, numbers, message):
    np.save(tmp_path / "latent.npy", numbers)
    with pytest.raises(RuntimeError, match=message):
        load(material, tmp_path / "latent.npy")
    assert not material.renderformer_v2.use_latent


def test_a_file_that_is_damaged_is_named(material, tmp_path):
    (tmp_path / "latent.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(RuntimeError, match="latent.npy"):
        load(material, tmp_path / "latent.npy")


def test_a_picture_of_a_sphere_becomes_a_latent_and_is_shown(material, tmp_path, bundle):
    y, x = np.mgrid[:256, :256] / 256
    sphere = np.stack([x, y, x * y], -1).astype(np.float32)
    write_panorama(tmp_path / "sphere.exr", sphere)
    assert load(material, tmp_path / "sphere.exr") == {"FINISHED"}
    found = np.float32(material.renderformer_v2.latent)
    np.testing.assert_allclose(found, material_panel.encode_sphere(sphere), atol=1e-3)
    with bpy.context.temp_override(material=material):
        assert bpy.ops.renderformer_v2.show_latent() == {"FINISHED"}
    shown = bpy.data.images["Latent of Measured"]
    pixels = np.empty((256, 256, 4), np.float32)
    shown.pixels.foreach_get(pixels.ravel())
    np.testing.assert_allclose(pixels[::-1, :, :3], material_panel.decode_sphere(found), atol=1e-3)


def test_a_picture_of_another_size_and_a_missing_autoencoder_are_said(material, tmp_path, monkeypatch):
    write_panorama(tmp_path / "small.exr", np.ones((8, 16, 3), np.float32))
    with pytest.raises(RuntimeError, match="256 x 256 pixels, found 16 x 8"):
        load(material, tmp_path / "small.exr")
    monkeypatch.setattr(published_weights, "bundle_folder", lambda: tmp_path)
    write_panorama(tmp_path / "sphere.exr", np.ones((256, 256, 3), np.float32))
    with pytest.raises(RuntimeError, match="material_autoencoder"):
        load(material, tmp_path / "sphere.exr")


@pytest.fixture
def brdf(tmp_path):
    """A file of a red matt BRDF."""
    table = np.broadcast_to(np.float32([0.2, 0.05, 0.05]), (*SHAPE, 3))
    MeasuredBRDF(table).save(tmp_path / "red.binary")
    return tmp_path / "red.binary"


def test_a_measured_brdf_becomes_the_latent_of_the_bundled_autoencoder(material, brdf):
    images = len(bpy.data.images)
    assert load(material, brdf) == {"FINISHED"} and len(bpy.data.images) == images
    latent = torch.tensor(material.renderformer_v2.latent[:])[None]
    decoded = load_component(MaterialAutoencoder, measured_latent.AUTOENCODER).decode(latent)[0]
    red, green, blue = decoded[:, 24:40, 24:40].mean((1, 2)).tolist()
    assert material.renderformer_v2.use_latent and red > 1.5 * green and green == pytest.approx(blue, rel=0.2)


def test_what_is_no_brdf_is_said_and_changes_nothing(material, tmp_path):
    for name in ("paint.binary", "paint_rgb.bsdf"):
        (tmp_path / name).write_bytes(b"nothing")
        with pytest.raises(RuntimeError, match=name):
            load(material, tmp_path / name)
    assert not material.renderformer_v2.use_latent


def test_encoding_can_be_cancelled(brdf, scene):
    encoding = material_panel.Encoding(brdf, scene.renderformer_v2)
    encoding.is_cancelled = True
    with pytest.raises(RenderCancelled):
        encoding.wait()
    assert not encoding.is_running and encoding.fraction < 1


def test_weights_of_another_autoencoder_are_refused(material, brdf, scene, tmp_path):
    """The room's bundle belongs to the bundled autoencoder, one of random mappers does not."""
    material_panel.require_bundled_latents(ROOM)
    scene.renderformer_v2.weights_source = "FOLDER"
    scene.renderformer_v2.weights_folder = str(write_bundle(tmp_path / "renderformer-v2", tiny_published_config()))
    with pytest.raises(RuntimeError, match="red.binary: these weights have latents of another autoencoder"):
        load(material, brdf)
    assert not material.renderformer_v2.use_latent
