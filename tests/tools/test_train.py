# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples, their symmetries, and resuming; on a scene made without Blender."""
import json
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.guided.encoders import panorama_size
from renderformer_v2.model.guided.features import FEATURES
from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.weights.presets import rf2_small
from tests.model.samples import floor_scene, floor_view
from tools.datagen.sample_files import load_sample, read_facts, save_sample
from tools.train import config, sample_cache
from tools.train.augment import turned_and_swapped
from tools.train.config import Stage, TrainConfig
from tools.train.errors import TrainingError
from tools.train.losses import PSNR_WEIGHT, image_loss, log_radiance, structure_loss
from tools.train.network import sample_loss
from tools.train.samples import LightInputs, build_sample, cached_sample, with_latents
from tools.train.state import TrainingState

TINY = replace(rf2_small(), latent_dim=48, num_layers=1, num_heads=1, dim_feedforward=64, num_register_tokens=2,
               intra_rope_pe_num_freqs=8, view_transformer_latent_dim=48, view_transformer_ffn_hidden_dim=64,
               view_transformer_n_heads=1, dpt_features=8, dpt_out_channels=(8, 8, 8, 8))


def mapper(parameters: torch.Tensor) -> torch.Tensor:
    return torch.tanh(torch.cat([parameters, parameters[..., :2]], -1))


@pytest.fixture
def stored(tmp_path):
    """A sample file whose reference is the unshadowed light of an environment and a lamp."""
    rng = np.random.default_rng(1)
    environment = np.kron(rng.random((8, 16, 3)), np.ones((32, 32, 1))).astype(np.float32)
    scene = replace(floor_scene(), environment=environment)
    view, guides = floor_view()
    shape = (64, 64, 3)
    reference = {f"{lobe}_{part}": rng.random(shape, np.float32) for lobe in LOBES for part in ("direct", "indirect")}
    combined = np.concatenate([guides.diffuse_color * 0.3, guides.alpha[..., None]], -1)
    path = tmp_path / "scene_00000001.npz"
    save_sample(path, scene, [view], [guides], [reference | {"combined": combined}])
    return path


def same(a, b, tolerance: float):
    for f in fields(a):
        x, y = getattr(a, f.name), getattr(b, f.name)
        if isinstance(x, torch.Tensor):
            torch.testing.assert_close(x, y, atol=tolerance, rtol=tolerance, msg=lambda m, f=f: f"{f.name}: {m}")
        elif x is not None:
            same(x, y, tolerance)


def test_the_cache_gives_back_what_was_built(stored, tmp_path):
    built = build_sample(stored)
    cached_sample(stored, tmp_path)
    same(cached_sample(stored, tmp_path), built, 2e-3)


@pytest.mark.slow
def test_the_cache_keeps_data_sets_apart_and_replaces_what_is_out_of_date(stored, tmp_path, monkeypatch):
    cache, other = tmp_path / "cache", tmp_path / "other" / stored.name
    cache.mkdir()
    other.parent.mkdir()
    scene, views, guides, passes = load_sample(stored)
    save_sample(other, scene, views, guides, [{name: 2 * x for name, x in p.items()} for p in passes])
    first = cached_sample(stored, cache)
    assert (cached_sample(other, cache).image.mean() > 1.5 * first.image.mean()) and len(list(cache.iterdir())) == 2
    for file in (other, stored):  # another content under the same name
        save_sample(file, scene, views, guides, [{name: 3 * x for name, x in p.items()} for p in passes])
        assert cached_sample(file, cache).image.mean() > 2.5 * first.image.mean()
    monkeypatch.setattr(sample_cache, "code_version", lambda sources: "newer")
    before = {file: file.stat().st_mtime_ns for file in cache.iterdir()}
    cached_sample(stored, cache), cached_sample(other, cache)
    after = {file: file.stat().st_mtime_ns for file in cache.iterdir()}
    assert set(after) == set(before) and all(after[file] > before[file] for file in before)
    cut_short = next(cache.iterdir())
    cut_short.write_bytes(cut_short.read_bytes()[:100])
    cached_sample(stored, cache), cached_sample(other, cache)


def test_the_version_of_the_preparing_code_covers_files_that_are_there():
    assert all(list(sample_cache.ROOT.glob(pattern)) for pattern in sample_cache.SOURCES + sample_cache.PUBLISHED)


def test_a_turned_scene_is_the_scene_of_a_turned_world(stored):
    """Direct light turns with lamps and panorama, and the augmented sample holds the turned ones."""
    sample = build_sample(stored)
    shift = 32  # a quarter turn
    columns = panorama_size(TINY)[1]
    turned = turned_and_swapped(sample, shift, torch.arange(3))
    environment = replace(floor_scene(), environment=np.kron(
        np.random.default_rng(1).random((8, 16, 3)), np.ones((32, 32, 1))).astype(np.float32)).environment
    quarter = np.float32([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    world = replace(floor_scene(), triangles=floor_scene().triangles @ quarter.T,
                    environment=np.roll(environment, -shift * 512 // columns, axis=1))
    x, v = torch.tensor([[0.3, -0.5, 0.0]]), torch.tensor([[0.0, 0.6, 0.8]])
    n = torch.tensor([[0.0, 0.0, 1.0]])
    still = DirectLight(replace(floor_scene(), environment=environment))
    turn, gloss = torch.tensor(quarter), torch.tensor([[0.4], [0.04]])
    torch.testing.assert_close(DirectLight(world).lobes(x @ turn.T, n, v @ turn.T, *gloss),
                               still.lobes(x, n, v, *gloss), rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(turned.inputs.triangles, sample.inputs.triangles @ turn.T, atol=1e-6, rtol=0)
    torch.testing.assert_close(turned.inputs.environment.ldr, sample.inputs.environment.ldr.roll(-shift, -1))
    torch.testing.assert_close(turned.image, sample.image)


def test_swapped_colours_keep_picture_and_parts_consistent(stored):
    sample = build_sample(stored)
    order = torch.tensor([2, 0, 1])
    swapped = turned_and_swapped(sample, 0, order)
    torch.testing.assert_close(swapped.view.light.radiance(), sample.view.light.radiance()[:, order])
    light, features = swapped.view.light, swapped.view.features()
    for name, axis in (("albedo", 2), ("direct", 2), ("bounced", 1), ("behind", 1), ("reflected", 1), ("refracted", 1),
                       ("glow", 1), ("traced", 1)):
        assert torch.equal(getattr(light, name), getattr(sample.view.light, name).index_select(axis, order)), name
    for name, axis in (("image", 1), ("direct", 2), ("indirect", 2)):
        assert torch.equal(getattr(swapped, name), getattr(sample, name).index_select(axis, order)), name
    colors, direct = (features[:, FEATURES[name]].unflatten(1, (3, 3)) for name in ("colors", "direct"))
    torch.testing.assert_close(colors, light.albedo)
    torch.testing.assert_close(torch.pow(10, direct) - 1, light.direct, rtol=1e-3, atol=1e-4)
    tiles, before = swapped.inputs.texture, sample.inputs.texture
    torch.testing.assert_close(tiles[:, :3], before[:, :3][:, order])
    torch.testing.assert_close(tiles[:, 3:], before[:, 3:])


def test_training_lowers_the_loss_and_resumes_exactly(stored, tmp_path):
    torch.manual_seed(0)
    sample = with_latents(build_sample(stored, LightInputs.SCENE), mapper)
    state = TrainingState(new_network(TINY), 2e-3, 0.01, 0.9)

    def step(state) -> float:
        torch.manual_seed(state.step)  # of what is dropped
        loss = sample_loss(state.model, sample, structure_loss)["total"]
        loss.backward()
        assert state.advance(2e-3, clip_norm=1.0)
        return loss.item()

    first = step(state)
    for _ in range(14):
        last = step(state)
    assert last < 0.8 * first
    state.save(tmp_path / "state.safetensors")
    resumed = TrainingState(new_network(TINY), 2e-3, 0.01, 0.9)
    assert resumed.resume(tmp_path / "state.safetensors")
    assert resumed.step == state.step
    assert step(resumed) == pytest.approx(step(state), rel=1e-5)
    for (name, a), (_, b) in zip(state.model.named_parameters(), resumed.model.named_parameters(), strict=True):
        torch.testing.assert_close(a, b, atol=1e-6, rtol=1e-4, msg=lambda m, name=name: f"{name}: {m}")


def test_the_curriculum_admits_scenes_by_what_they_hold(stored, tmp_path):
    plain = read_facts(stored)
    assert plain.environment and not (plain.volumes or plain.transmission) and plain.views == 1
    assert (plain.triangles, plain.width, plain.height) == (len(floor_scene()), 64, 64)
    assert Stage(1, volumes=False, transmission=False).admits(plain) and not Stage(1, environment=False).admits(plain)
    assert not Stage(1, max_triangles=10).admits(plain) and Stage(1).admits_all()
    scene, views, guides, passes = load_sample(stored)
    glass = [replace(guide, transmission_color=np.ones_like(guide.transmission_color)) for guide in guides]
    tiles = np.random.default_rng(0).random(scene.tiles.shape, np.float32)
    save_sample(tmp_path / "scene_2.npz", replace(scene, tiles=tiles, environment=None), views, glass, passes)
    other = read_facts(tmp_path / "scene_2.npz")
    assert other.transmission and not other.environment and not Stage(1, transmission=False).admits(other)
    assert other.textures and not plain.textures and not Stage(1, textures=False).admits(other)


def changed(**values) -> str:
    return json.dumps(json.loads(Path(config.__file__).with_name("rf2_small.json").read_text()) | values)


def test_configuration_names_wrong_keys(tmp_path):
    path = tmp_path / "config.json"
    for text, wrong in (('{"preset": "rf2_small", "learning_rat": 1}', "unknown keys learning_rat"),
                        ('{"preset": "rf2_small"}', "missing keys .*learning_rate"), ("{", "cannot be read"),
                        ("[1]", "expected a JSON object, not .1."),
                        (changed(preset="rf2_smal"), "preset must be one of .*rf2_small, not 'rf2_smal'"),
                        (changed(preset=[]), "preset must be one of"),
                        (changed(network={"windows": 1}), "unknown keys in model_config: windows"),
                        (changed(network={"dense": 1}), "dense = 1 is not of the kind bool"),
                        (changed(network=[]), "network must be a JSON object"),
                        (changed(network={"guidance": {"transformer": 1}}), "unknown keys in guidance: transformer"),
                        (changed(stages=[]), "stages must be a list"),
                        (changed(stages=5), "stages must be a list"),
                        (changed(stages=[{"steps": 1}, {"steps": 2, "glass": 1}]), "stages.1.: unknown keys glass"),
                        (changed(stages=[{}]), "stages.0.: missing keys steps"),
                        (changed(stages=[7]), "stages.0.: expected a JSON object, not 7")):
        path.write_text(text)
        with pytest.raises(TrainingError, match=wrong):
            TrainConfig.load(path)


def test_a_configuration_may_change_the_network(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(changed(network={"light_sinks": False, "summary_block_size": 16}))
    config = TrainConfig.load(path).model()
    assert (config.light_sinks, config.summary_block_size, config.summaries) == (False, 16, True)


def test_the_learning_rate_rises_and_falls_by_steps(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(changed(learning_rate=0.1, warmup_steps=10, cosine_steps=100))
    rates = [TrainConfig.load(path).rate(step) for step in range(150)]
    assert rates[:10] == pytest.approx([0.01 * (step + 1) for step in range(10)])
    assert rates[10] == pytest.approx(0.1) and rates[60] == pytest.approx(0.0505)
    assert rates[10:] == sorted(rates[10:], reverse=True) and rates[110:] == pytest.approx([0.001] * 40)
    path.write_text(changed(learning_rate=0.1, warmup_steps=10))
    assert TrainConfig.load(path).rate(10_000) == pytest.approx(0.1)


def test_parts_of_a_network_are_trained_alone(tmp_path):
    model, path = new_network(TINY), tmp_path / "config.json"
    path.write_text(changed(parts=["kernel_predictor.", "bundle_decoder."]))
    TrainConfig.load(path).train(model)
    trained = {name for name, p in model.named_parameters() if p.requires_grad}
    assert {name.split(".")[0] for name in trained} == {"kernel_predictor", "bundle_decoder"} and len(trained) > 10
    path.write_text(changed())
    TrainConfig.load(path).train(model)
    assert {name for name, p in model.named_parameters() if not p.requires_grad} == {
        "transformer.rope_emb.freqs", "view_transformer.transformer.rope_emb.freqs"}
    path.write_text(changed(parts=["kernel_predictors."]))
    with pytest.raises(TrainingError, match="kernel_predictors"):
        TrainConfig.load(path).train(model)


def test_dark_places_count_as_on_a_screen():
    dark, bright, off = torch.full((1, 3, 32, 32), 0.01), torch.full((1, 3, 32, 32), 0.8), 0.01
    none = lambda a, b: 0.0  # noqa: E731
    assert image_loss(dark + off, dark, none) > 3 * image_loss(bright + off, bright, none) > 0
    too_bright = torch.full((1, 3, 32, 32), 3.0, requires_grad=True)
    image_loss(too_bright, bright, none).backward()
    assert (too_bright.grad > 0).all()


def test_negative_light_has_gradients_and_positive_light_its_logarithm():
    picture = torch.tensor([-0.5, -1e-3, 0.0, 0.2, 7.0], requires_grad=True)
    torch.testing.assert_close(log_radiance(picture)[2:], torch.log10(1 + picture)[2:])
    negative = picture.view(1, 1, 1, 5).expand(1, 3, 32, 5)
    image_loss(negative, torch.full_like(negative, 9.0), lambda a, b: 0.0).backward()
    assert (picture.grad < 0).all()


def test_a_picture_that_is_nearly_right_still_gains_by_its_decibels():
    picture, none = torch.full((1, 3, 32, 32), 0.5), lambda a, b: 0.0
    for off in (0.2, 0.02):
        gain = image_loss(picture + off, picture, none) - image_loss(picture + off / 2, picture, none)
        assert gain > 0.85 * PSNR_WEIGHT * 10 * math.log10(4)


def test_equal_pictures_cost_nothing():
    picture = torch.rand(1, 3, 32, 32)
    assert float(image_loss(picture, picture, structure_loss)) == pytest.approx(0, abs=1e-6)
    assert float(image_loss(picture, picture.roll(3, -1), structure_loss)) > 0.01


def test_equal_tiles_with_other_latents_stay_apart_in_a_sample(tmp_path):
    scene, (view, guides) = floor_scene(), floor_view()
    scene.tiles, scene.latents = np.repeat(scene.tiles, 3, axis=0), np.zeros((3, 9), np.float32)
    scene.latents[2], scene.tile_index[5] = 0.5, 2
    scene.two_lobes = np.zeros((3, 7, 32, 32), np.float16)
    scene.two_lobes[2] = 0.25
    save_sample(tmp_path / "scene_1.npz", scene, [view], [guides], [{"combined": np.zeros((64, 64, 4))}])
    found = load_sample(tmp_path / "scene_1.npz").scene
    found.validate()
    assert len(found.tiles) == 2 and found.latents[found.tile_index[5]].tolist() == [0.5] * 9
    assert not found.latents[found.tile_index[0]].any()
    assert (found.two_lobes[found.tile_index[5]] == 0.25).all() and not found.two_lobes[found.tile_index[0]].any()
