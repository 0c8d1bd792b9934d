# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering with a published bundle: latents as the specification says, each computed once, and a picture."""
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from renderformer_v2.model import progress
from renderformer_v2.model.camera import square_view
from renderformer_v2.model.errors import CheckpointError, RenderCancelled, SceneError
from renderformer_v2.model.material.mappers import MAPPERS, Appearance
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.published import image_encoder
from renderformer_v2.model.published.bundle_files import AUTOMATIC, TRANSFORMERS, check_weights
from renderformer_v2.model.published.h5 import read_h5, write_h5
from renderformer_v2.model.published.image_encoder import ImageEncoder, OneFrameEncoder, find_vae
from renderformer_v2.model.published.processed_scene import square_fov
from renderformer_v2.model.published.scene_encoder import SceneEncoder
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.scene import BASE_COLOR
from tests.model.published.bundles import tiny_vae, write_bundle
from tests.model.samples import floor_scene, floor_view
from tools.parity.cases import with_recipe_weights


@pytest.fixture(scope="module")
def renderer(published_bundle) -> Renderer:
    return Renderer(published_bundle, device="cpu", precision="fp32")


@pytest.fixture(scope="module")
def vae():
    return tiny_vae()


def official(vae, images: torch.Tensor) -> torch.Tensor:
    """Posterior mean of one-frame videos, by diffusers itself."""
    with torch.no_grad():
        return vae.encode(images.float()[:, :, None]).latent_dist.mean[:, :, 0]


def real_vae():
    """The released sizes: 126,892,531 parameters, of which the encoder's get values."""
    from diffusers import AutoencoderKLQwenImage
    with torch.device("meta"):
        vae = AutoencoderKLQwenImage()
    assert sum(p.numel() for p in vae.parameters()) == 126_892_531
    vae.encoder.to_empty(device="cpu"), vae.quant_conv.to_empty(device="cpu")
    for part in (vae.encoder, vae.quant_conv):
        for p in part.parameters():
            torch.nn.init.uniform_(p, -0.04, 0.04)
    return vae.requires_grad_(False).eval()


@pytest.mark.parametrize("make", [tiny_vae, real_vae])
@torch.no_grad()
def test_encoding_one_frame_equals_the_video_encoder(make):
    vae, images = make(), torch.rand(2, 3, 32, 32) * 2 - 1
    expected = official(vae, images)
    assert expected.shape == (2, 16, 4, 4) and expected.std() > 0
    torch.testing.assert_close(OneFrameEncoder(vae)(images), expected, rtol=1e-4, atol=1e-5 * expected.abs().max())


def test_appearance_takes_the_mapper_of_the_material():
    mappers = {name: with_recipe_weights(kind(hidden_dim=8, num_layers=2)) for name, kind in MAPPERS.items()}
    diffuse, metallic, transmission = (mappers[n] for n in (
        "diffspec_mapper", "metallic_mapper", "metallic_transmission_mapper"))
    color = [0.2, 0.4, 0.6]
    parameters = torch.tensor([color + [0, 0.3, 1, 0], color + [0, 0.3, 1.5, 0], color + [1, 0.3, 1.3, 0],
                               color + [0, 0.3, 1.33, 0], color + [0, 0.3, 1, 1]])
    with torch.no_grad():
        latents = Appearance(diffuse, metallic, transmission)(parameters)
        expected = [diffuse(torch.tensor(color + [0, 0, 0, 1.0])), metallic(torch.tensor(color + [0, 0.3])),
                    metallic(torch.tensor(color + [1, 0.3])), transmission(parameters[3]), transmission(parameters[4])]
    torch.testing.assert_close(latents, torch.stack(expected))


@torch.no_grad()
def test_constant_materials_equal_direct_encoding_and_are_encoded_once(renderer, vae, published_bundle, monkeypatch):
    pipeline = renderer.pipeline
    images = ImageEncoder(published_bundle / "vae")
    monkeypatch.setattr(pipeline, "encoder", SceneEncoder(pipeline.encoder.appearance, images))
    encoded, encode = [], images._encode
    monkeypatch.setattr(images, "_encode", lambda batch: encoded.append(len(batch)) or encode(batch))
    scene = floor_scene()
    processed = pipeline.encoder.process(scene)
    assert processed.texture.shape == (2, 80, 4, 4) and processed.texture.dtype == np.float16
    assert sum(encoded) == 2 * 3 + 2  # three triples of each latent; the normal and the height are shared

    base, roughness = scene.tiles[0, BASE_COLOR, 0, 0], scene.tiles[0, 4, 0, 0]
    mapped = pipeline.bundle.mapper("metallic_transmission_mapper")(
        torch.tensor([*base, 0, roughness, scene.tiles[0, 5, 0, 0], 0], dtype=torch.float32))
    white = pipeline.bundle.mapper("diffspec_mapper")(torch.tensor([1, 1, 1, 0, 0, 0, 1.0]))
    for material, latent in ((0, mapped), (1, white)):
        values = torch.cat([latent.half().float(), torch.tensor([0, 0, 1.0]), torch.zeros(3)])
        direct = official(vae, values.view(5, 3, 1, 1).expand(-1, -1, 32, 32)).reshape(80, 4, 4)
        np.testing.assert_allclose(processed.texture[material], direct, rtol=2e-3, atol=2e-3 * direct.abs().max())
    assert (processed.texture_index == scene.is_light).all()

    pipeline.encoder.process(scene)
    assert sum(encoded) == 8


def test_textures_report_progress_and_can_be_cancelled(renderer):
    scene = floor_scene(side=12)
    tiles = np.repeat(scene.tiles, 100, axis=0)
    tiles[:, BASE_COLOR] = np.random.default_rng(0).random((100, 3, 32, 32))
    scene = replace(scene, tiles=tiles, tile_index=(np.arange(len(scene)) % 100).astype(np.int32))
    steps = []

    def cancel(text, fraction):
        steps.append(text)
        if text.startswith("Encoding textures, 64 of"):
            raise RenderCancelled()

    renderer.encode(floor_scene())  # knows the light's tile
    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        renderer.encode(scene)
    assert "Encoding textures, 0 of 100" in steps
    steps.clear()
    with progress.reporting(cancel):  # goes on where it stopped
        renderer.encode(scene)
    assert "Encoding textures, 0 of 36" in steps


def test_picture_is_finite_empty_where_nothing_is_seen_and_again_the_same(renderer):
    scene, (view, guides) = floor_scene(), floor_view(50, 37)
    guides.hit_triangle[5, 5] = len(scene) - 1
    guides.alpha[5, 5] = 1
    guides.emission[5, 5] = 7
    fractions = []
    with progress.reporting(lambda text, fraction: fractions.append(fraction)):
        with progress.part(0.0, 0.5):
            encoded = renderer.encode(scene)
        with progress.part(0.5, 1.0):
            picture = encoded.view(view, guides)
    assert picture.shape == (37, 50, 3) and np.isfinite(picture).all() and picture.min() >= 0 and picture.max() > 0
    assert not picture[guides.alpha == 0].any() and not picture[5, 5].any()
    assert fractions == sorted(fractions) and encoded.tokens > len(scene)
    np.testing.assert_array_equal(picture, encoded.view(view, guides))


@pytest.fixture(scope="module")
def both(tmp_path_factory, tiny_config):
    """A bundle with two transformers of different weights."""
    return write_bundle(tmp_path_factory.mktemp("both") / "renderformer-v2", tiny_config, TRANSFORMERS)


def picture(bundle: Path, size: int, transformer: str = AUTOMATIC) -> np.ndarray:
    """The floor, as a part of a picture of that size."""
    view, guides = floor_view()
    renderer = Renderer(bundle, device="cpu", precision="fp32", transformer=transformer)
    return renderer.encode(floor_scene(), size).view(replace(view, picture_size=size), guides)


def test_large_pictures_are_drawn_by_the_network_for_them_unless_another_is_chosen(both, tmp_path):
    small, large = picture(both, 1920), picture(both, 2048)
    assert np.abs(small - large).max() > 0.01 * small.max() and large.max() > 0
    np.testing.assert_array_equal(picture(both, 1920, "transformer_2048"), large)
    np.testing.assert_array_equal(picture(both, 2048, "transformer_512"), small)
    shutil.copytree(both, tmp_path / "large", ignore=shutil.ignore_patterns("transformer_512"))
    np.testing.assert_array_equal(picture(tmp_path / "large", 1920), large)
    with pytest.raises(CheckpointError, match="transformer_512"):
        picture(tmp_path / "large", 1920, "transformer_512")


def test_a_transformer_that_its_authors_code_saved_is_read(published_bundle, tmp_path):
    folder = tmp_path / "renderformer-v2"
    shutil.copytree(published_bundle, folder)
    file = folder / "transformer_512" / "config.yaml"
    section = yaml.safe_load(file.read_text())["model_config"]
    file.unlink()
    saved = {"format": "renderformer-model", "format_version": 1, "model_config": section}
    file.with_name("model_config.json").write_text(json.dumps(saved))
    np.testing.assert_array_equal(picture(folder, 512), picture(published_bundle, 512))
    file.with_name("model_config.json").write_text(json.dumps(saved | {"format_version": 3}))
    with pytest.raises(CheckpointError, match="model_config.json .* expected .*'format_version': 1.* found .*3"):
        picture(folder, 512)
    file.with_name("model_config.json").write_text(json.dumps(saved | {"model_config": section | {"colour": 1}}))
    with pytest.raises(CheckpointError, match="model_config.json: unknown keys in model_config: colour"):
        picture(folder, 512)


def saved_by_itself(bundle: Path, folder: Path) -> Path:
    """One transformer of a bundle as the authors' `save_pretrained` writes it."""
    folder.mkdir()
    section = yaml.safe_load((bundle / "transformer_512" / "config.yaml").read_text())["model_config"]
    (folder / "model_config.json").write_text(json.dumps({
        "format": "renderformer-model", "format_version": 1, "model_config": section}))
    shutil.copyfile(bundle / "transformer_512" / "model.safetensors", folder / "model.safetensors")
    return folder


def test_a_transformer_beside_the_mappers_may_be_chosen_by_its_own_folder(both, tmp_path):
    folder = tmp_path / "renderformer-v2"
    shutil.copytree(both, folder, ignore=shutil.ignore_patterns("transformer_512"))
    tuned = saved_by_itself(both, folder / "my tuned one")
    check_weights(tuned)
    np.testing.assert_array_equal(picture(tuned, 2048), picture(both, 2048, "transformer_512"))
    np.testing.assert_array_equal(picture(folder / "transformer_2048", 512), picture(both, 2048))


def test_a_transformer_alone_is_told_where_it_belongs(both, tmp_path):
    alone = saved_by_itself(both, tmp_path / "tuned")
    with pytest.raises(CheckpointError, match="tuned also needs diffspec_mapper.*by itself belongs into it"):
        check_weights(alone)
    with pytest.raises(CheckpointError, match="also needs diffspec_mapper"):
        picture(alone, 512)
    (alone / "model.safetensors").unlink()
    with pytest.raises(CheckpointError, match="needs tuned, diffspec_mapper"):
        check_weights(alone)


def test_a_border_is_rendered_by_the_network_of_the_whole_picture(both):
    view, guides = floor_view()
    renderer = Renderer(both, device="cpu", precision="fp32")
    assert renderer.pipeline.variant(replace(view, picture_size=4096).longer_side) == "transformer_2048"
    assert renderer.pipeline.variant(view.longer_side) == "transformer_512"
    with pytest.raises(ValueError, match="transformer_2048"):
        renderer.encode(floor_scene()).view(replace(view, picture_size=4096), guides)


def test_exported_scene_renders_the_same_picture(renderer, tmp_path):
    scene, (view, guides) = floor_scene(), floor_view()
    scene.environment = np.full((256, 512, 3), 0.5, np.float32)
    write_h5(tmp_path / "scene.h5", renderer.pipeline.process(scene, [view]))
    image = renderer.pipeline.render_processed(read_h5(tmp_path / "scene.h5"), 64)[0]
    expected = renderer.encode(scene).view(view, guides) * Normalization.of(scene).exposure
    np.testing.assert_allclose(image[guides.alpha > 0], expected[guides.alpha > 0], rtol=5e-3, atol=5e-3)
    assert image.std() > 1e-3


def test_a_square_picture_is_what_the_file_can_hold():
    view = square_view(np.eye(4), 40, 128)
    assert square_fov(view) == pytest.approx(40, abs=1e-4)
    assert square_fov(square_view(np.eye(4), 40, 128, crop=(32, 0, 64, 128))) == pytest.approx(40, abs=1e-4)
    with pytest.raises(SceneError, match="shift"):
        square_fov(replace(view, principal=view.principal + 3))


def test_what_is_missing_is_named(published_bundle, tmp_path, monkeypatch):
    folder = tmp_path / "renderformer-v2"
    shutil.copytree(published_bundle, folder, ignore=shutil.ignore_patterns("vae"))
    with pytest.raises(CheckpointError, match="VAE of Qwen/Qwen-Image"):
        Renderer(folder, device="cpu", precision="fp32")
    shutil.copytree(published_bundle / "vae", tmp_path / "Qwen-Image" / "vae")
    assert find_vae(folder) == tmp_path / "Qwen-Image" / "vae"
    with monkeypatch.context() as patch:
        patch.setattr(image_encoder.importlib.util, "find_spec", lambda name: None)
        with pytest.raises(CheckpointError, match="pip install diffusers"):
            Renderer(folder, device="cpu", precision="fp32")
    shutil.rmtree(folder / "metallic_mapper")
    (folder / "transformer_512" / "model.safetensors").unlink()
    with pytest.raises(CheckpointError, match="needs transformer_512 or transformer_2048, metallic_mapper, .* it holds "
                                              "diffspec_mapper, metallic_transmission_mapper, transformer_512"):
        Renderer(folder, device="cpu", precision="fp32")


@pytest.mark.parametrize("name", ["transformer_512/model.safetensors", "metallic_mapper/model.safetensors",
                                  "vae/diffusion_pytorch_model.safetensors"])
def test_a_clone_without_lfs_is_told_how_to_get_the_files(published_bundle, tmp_path, name):
    folder = tmp_path / "renderformer-v2"
    shutil.copytree(published_bundle, folder)
    (folder / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 7\n")
    with pytest.raises(CheckpointError, match=f"{name} stands for a file that was not downloaded: run `git lfs pull`"):
        picture(folder, 512)


@pytest.mark.parametrize("spoil", [
    lambda content: b"", lambda content: content[:len(content) // 2], lambda content: b"<html>Log in</html>",
    lambda content: bytes(256) + content[256:]], ids=["empty", "half", "login", "noise"])
@pytest.mark.parametrize("name", ["transformer_512/model", "diffspec_mapper/model", "vae/diffusion_pytorch_model"])
def test_damaged_weights_are_named(published_bundle, tmp_path, name, spoil):
    folder = tmp_path / "renderformer-v2"
    shutil.copytree(published_bundle, folder)
    file = folder / f"{name}.safetensors"
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(CheckpointError, match=f"{name}.safetensors is damaged or incomplete.*again"):
        picture(folder, 512)


def test_a_given_latent_takes_the_place_of_parameters(renderer):
    """What the image encoder is given for such a tile is the latent, and normal and height of the tile."""
    pipeline, scene, (view, _) = renderer.pipeline, floor_scene(), floor_view()
    latent = np.linspace(-0.9, 0.9, 9).astype(np.float32)
    plain = pipeline.process(scene, [view])
    given = pipeline.process(replace(scene, latents=latent[None]), [view])
    raw = np.zeros((1, 16, 32, 32), np.float16)
    raw[:, :9], raw[:, 11] = latent[:, None, None], 1
    expected = pipeline.encoder.inputs(replace(given, texture=raw, texture_index=np.zeros(len(scene), int))).texture
    floor = given.texture_index[0]
    np.testing.assert_allclose(given.texture[floor], expected[0], atol=2e-3)
    assert np.abs(given.texture[floor] - plain.texture[plain.texture_index[0]]).max() > 0.01
    assert np.array_equal(given.texture[given.texture_index[-1]], plain.texture[plain.texture_index[-1]])


def test_diffuse_and_specular_go_through_their_own_mapper(renderer):
    pipeline, scene, (view, _) = renderer.pipeline, floor_scene(), floor_view()
    lobes = np.float16([0.2, 0.4, 0.6, 0.3, 0.2, 0.1, 0.25])
    given = pipeline.process(replace(scene, two_lobes=np.tile(lobes[:, None, None], (1, 1, 32, 32))), [view])
    latent = pipeline.encoder.appearance.diffuse_specular(torch.from_numpy(lobes).float())
    expected = pipeline.process(replace(scene, latents=latent.detach().numpy()[None]), [view])
    np.testing.assert_allclose(given.texture[given.texture_index[0]], expected.texture[expected.texture_index[0]],
                               atol=2e-3)
    assert np.array_equal(given.texture[given.texture_index[-1]], expected.texture[expected.texture_index[-1]])


def test_a_texture_of_version_1_is_encoded_as_diffuse_and_specular(renderer):
    pipeline, scene, (view, _) = renderer.pipeline, floor_scene(), floor_view()
    lobes = np.float16([0.2, 0.4, 0.6, 0.3, 0.2, 0.1, 0.25])
    expected = pipeline.process(replace(scene, two_lobes=np.tile(lobes[:, None, None], (1, 1, 32, 32))), [view])
    tile = np.zeros((13, 32, 32), np.float16)
    inside = np.add.outer(np.arange(32), np.arange(32)) <= 32
    tile[:10, inside] = np.float16([*lobes, 0.5, 0.5, 1])[:, None]
    version_1 = replace(expected, texture=np.repeat(tile[None], len(scene), 0), texture_index=np.arange(len(scene)))
    found = pipeline.encoder.encoded(version_1)
    np.testing.assert_allclose(found.texture[0], expected.texture[expected.texture_index[0]], atol=2e-3)


def test_views_are_drawn_one_by_one_or_together(renderer):
    view = floor_view()[0]
    scene = renderer.pipeline.process(floor_scene(), [view, square_view(view.camera_to_world, 70, 64)])
    alone, together = (renderer.render(scene, resolution=64, batch=batch) for batch in (1, 2))
    np.testing.assert_allclose(alone, together, rtol=1e-3, atol=1e-4)
    assert len(renderer.render(scene.first_view(), resolution=64)) == 1


def test_a_picture_of_h5_needs_published_weights(renderer):
    scene = renderer.pipeline.process(floor_scene(), [floor_view()[0]])
    with pytest.raises(CheckpointError, match="published weights"):
        Renderer().render(scene)
