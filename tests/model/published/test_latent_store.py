# SPDX-License-Identifier: GPL-3.0-or-later
"""Latents on disk: what is found again, what is encoded anew; the file stays small and never stops a render."""
import shutil
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.published import latent_store
from renderformer_v2.model.published.image_encoder import ImageEncoder
from renderformer_v2.model.published.latent_store import LatentStore
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.scene import BASE_COLOR, RenderScene
from tests.model.samples import floor_scene, floor_view


@pytest.fixture
def encoded(monkeypatch) -> list[int]:
    """How many images were encoded at each call of the network."""
    counts = []

    def encode(images, batch, real=ImageEncoder._encode):
        counts.append(len(batch))
        return real(images, batch)
    monkeypatch.setattr(ImageEncoder, "_encode", encode)
    return counts


def textured(count: int = 6) -> RenderScene:
    """The floor, with `count` different tiles and each of them twice."""
    scene = floor_scene(side=4)
    tiles = np.repeat(scene.tiles, count, axis=0)
    tiles[:, BASE_COLOR] = np.random.default_rng(1).random((count, 3, 32, 32))
    return replace(scene, tiles=np.concatenate([tiles, tiles]),
                   tile_index=(np.arange(len(scene)) % (2 * count)).astype(np.int32))


def picture(bundle, file, scene) -> np.ndarray:
    renderer = Renderer(bundle, device="cpu", precision="fp32", latents=file)
    renderer.prepare(scene)
    return renderer.encode(scene).view(*floor_view())


def test_another_process_finds_textures_and_environment_again(published_bundle, tmp_path, encoded):
    scene, file = textured(), tmp_path / "user" / "latents.sqlite"
    scene.environment = np.random.default_rng(2).random((256, 512, 3)).astype(np.float32)
    first = picture(published_bundle, file, scene)
    # The normal and the height are one each, a light's tile adds three images, the environment is two.
    assert sum(encoded) == 6 * 3 + 2 + 3 + 2
    encoded.clear()
    np.testing.assert_array_equal(picture(published_bundle, file, scene), first)
    assert not encoded
    scene.tiles[[0, 6], 0, 0, 0] += 0.5
    assert np.abs(picture(published_bundle, file, scene) - first).max() > 0
    assert sum(encoded) == 5  # of that tile alone
    # Other images in the batch change the last digits.
    np.testing.assert_allclose(picture(published_bundle, None, scene), picture(published_bundle, file, scene),
                               rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("part", ["vae/diffusion_pytorch_model", "metallic_transmission_mapper/model"])
def test_other_weights_have_latents_of_their_own(published_bundle, tmp_path, encoded, part):
    from safetensors.torch import load_file, save_file
    folder, file, scene = tmp_path / "renderformer-v2", tmp_path / "latents.sqlite", textured()
    shutil.copytree(published_bundle, folder)
    picture(folder, file, scene)
    count = sum(encoded)
    weights = folder / f"{part}.safetensors"
    state = {key: value * 1.5 for key, value in load_file(weights).items()}
    weights.unlink()
    save_file(state, weights)
    picture(folder, file, scene)
    assert sum(encoded) == 2 * count


def test_the_oldest_go_when_it_is_full(tmp_path, monkeypatch):
    store, days = LatentStore(tmp_path / "latents.sqlite", limit=1 << 20), iter(range(100))
    monkeypatch.setattr(latent_store, "today", lambda: next(days))
    keys = [i.to_bytes(16, "little") for i in range(1000)]
    for i in range(0, 1000, 50):
        store.put({key: bytes(2560) for key in keys[i:i + 50]})
        assert keys[0] in store.get(keys[:1])  # asked for all the time
        assert store.bytes() <= (1 << 20) + 50 * 2 * 2560
    found = store.get(keys)
    assert set(keys[-50:]) <= set(found) and keys[200] not in found and 100 < len(found) < 420
    assert (tmp_path / "latents.sqlite").stat().st_size < 2 << 20


@pytest.mark.parametrize("spoil", [lambda file: file.write_bytes(b"no database" * 1000),
                                   lambda file: file.mkdir(), lambda file: file.parent.write_bytes(b"")])
def test_a_file_that_cannot_be_used_stops_nothing(tmp_path, spoil):
    file = tmp_path / "latents" / "latents.sqlite"
    if spoil.__code__.co_names[0] != "parent":
        file.parent.mkdir()
    spoil(file)
    store = LatentStore(file)
    store.put({b"key": b"value"})
    assert store.get([b"key", b"other"]) == {b"key": b"value"}


def test_a_damaged_file_is_made_anew(tmp_path):
    file = tmp_path / "latents.sqlite"
    file.write_bytes(b"no database" * 1000)
    LatentStore(file).put({b"key": b"value"})
    assert LatentStore(file).get([b"key"]) == {b"key": b"value"}
