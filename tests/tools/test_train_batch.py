# SPDX-License-Identifier: GPL-3.0-or-later
"""Several scenes in one pass are what they are alone; mirrored and resized ones are those of other worlds."""
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import uncontracted
from renderformer_v2.model.guided.features import OFFSET_SCALE, SURFACE
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.light.direct.emitter_light import EMITTER
from renderformer_v2.model.material.mappers import load_material_mapper
from renderformer_v2.model.scene import Volumes
from renderformer_v2.model.weights.presets import BUNDLED, PRESETS
from tests.model.samples import closed_box, floor_scene, floor_view, walls
from tools.datagen.sample_files import save_sample
from tools.train.augment import mirrored, resized
from tools.train.batch import Batching, batches, embed, joined, padded_length, render_batch
from tools.train.captured import CapturedLosses, rebuilt, tensors_of
from tools.train.errors import TrainingError
from tools.train.losses import structure_loss
from tools.train.network import batch_loss, embedded_loss, main, sample_loss
from tools.train.sample_cache import _flatten
from tools.train.samples import LOBES, LightInputs, build_sample, with_latents

CONFIG = PRESETS[BUNDLED]()
WEIGHTS = Path(__file__).parents[2] / "model" / "weights" / BUNDLED


def with_cells(scene, count: int):
    random = np.random.default_rng(count)
    three = lambda low, high: random.uniform(low, high, (count, 3)).astype(np.float32)  # noqa: E731
    return replace(scene, volumes=Volumes(
        density=random.random((count, 64), np.float32), position=three(-0.5, 0.5), rotation=three(-1, 1),
        scale=three(0.1, 0.2), scattering=three(0, 1), absorption=three(0, 1)))


def with_sky(scene):
    sky = np.random.default_rng(5).random((256, 512, 3)).astype(np.float32)
    return replace(scene, environment=sky)


SCENES = {"floor": floor_scene(16), "media": with_cells(floor_scene(4), 70), "room": closed_box((0.8, 0.1, 0.1)),
          "sky": with_sky(walls((0.1, 0.7, 0.2)))}


def write(path: Path, scene, size: int = 64) -> Path:
    view, guides = floor_view(size, size)
    light = np.full((size, size, 3), 0.2, np.float32)
    light[:, size // 2:] *= 0.5
    passes = {f"{lobe}_{part}": light for lobe in LOBES for part in ("direct", "indirect")}
    passes["combined"] = np.concatenate([guides.diffuse_color * light, guides.alpha[..., None]], -1)
    save_sample(path, scene, [view], [guides], [passes])
    return path


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> list:
    folder = tmp_path_factory.mktemp("samples")
    return [build_sample(write(folder / f"scene_{i}.npz", scene), LightInputs.SCENE)
            for i, scene in enumerate(SCENES.values())]


def test_a_batch_is_rendered_as_its_scenes_are(samples):
    network, mapper = load_network(WEIGHTS), load_material_mapper()
    torch.nn.init.normal_(network.bundle_decoder.project.weight, std=0.05)
    mapped = [with_latents(sample, mapper) for sample in samples]
    batch = joined(mapped, CONFIG)
    assert len(set(batch.length.tolist())) == len(mapped) == len(batch)
    with torch.no_grad():
        alone = torch.cat([network.render_view(network.encode_scene(s.inputs), s.view) for s in mapped])
        together = render_batch(network, embed(network, batch), batch)
    assert alone.std() > 0.01
    torch.testing.assert_close(together, alone, atol=2e-5, rtol=1e-4)


def test_the_loss_of_a_batch_is_the_mean_of_its_scenes_and_reaches_all_weights(samples):
    network, mapper = load_network(WEIGHTS).train().requires_grad_(), load_material_mapper()
    alone = [sample_loss(network, with_latents(sample, mapper), structure_loss) for sample in samples]
    together = batch_loss(network, joined(samples, CONFIG), mapper, structure_loss)
    for name in ("finished", "image"):
        torch.testing.assert_close(together[name], torch.stack([loss[name] for loss in alone]).mean())
    together["total"].backward()
    for name, p in network.named_parameters():
        if not name.endswith("rope_emb.freqs"):
            assert p.grad is not None and p.grad.isfinite().all(), name


def test_batches_hold_views_of_one_size_and_problems_are_passed_on(tmp_path, samples):
    large = build_sample(write(tmp_path / "scene_9.npz", floor_scene(), size=128), LightInputs.SCENE)
    problem = TrainingError("none")
    found = list(batches([samples[0], large, samples[1], problem, samples[2], large], Batching(2, CONFIG)))
    assert [batch if batch is problem else tuple(batch.sample.image.shape) for batch in found] == [
        (2, 3, 64, 64), problem, (2, 3, 128, 128)]
    assert torch.equal(found[0].restored().sample.image[1], samples[1].image[0].half().float())


def test_sequences_are_padded_to_the_least_length_that_fits_and_padding_changes_nothing(samples):
    lengths = [padded_length(sample.inputs, CONFIG, (400, 160)) for sample in samples]
    exact = [joined([sample], CONFIG).length.item() for sample in samples]
    assert lengths == [160 if length <= 160 else 400 if length <= 400 else None for length in exact]
    assert {160, 400} <= {*lengths} and padded_length(samples[0].inputs, CONFIG, (1,)) is None
    network, (mapped,) = load_network(WEIGHTS), [with_latents(samples[2], load_material_mapper())]
    pictures = []
    for length in (None, 400):
        batch = joined([mapped], CONFIG, length)
        with torch.no_grad():
            pictures.append(render_batch(network, embed(network, batch), batch))
    assert batch.rows.shape == (1, 400)
    torch.testing.assert_close(*pictures, atol=2e-5, rtol=1e-4)


def test_the_tensors_of_a_batch_are_found_and_put_back(samples):
    batch = joined(samples, CONFIG)
    found = tensors_of(batch)
    again = rebuilt(batch, iter([tensor + 1 for tensor in found]))
    assert torch.equal(again.sample.view.light.direct, batch.sample.view.light.direct + 1)
    assert [x.shape for x in tensors_of(again)] == [x.shape for x in found]


@pytest.mark.skipif(not torch.cuda.is_available(), reason="CUDA graphs need a card")
def test_captured_losses_and_gradients_are_those_of_the_operations(samples):
    network, mapper = load_network(WEIGHTS).cuda().train().requires_grad_(), load_material_mapper().cuda()
    captured = CapturedLosses(network, partial(embedded_loss, network, perceptual=structure_loss), (400,))
    for of_batch in (samples, samples[::-1]):  # the second one is replayed
        batch, found = joined(of_batch, CONFIG, 400).to("cuda"), []
        for graphs in (captured, None):
            network.zero_grad(set_to_none=True)
            losses = batch_loss(network, batch, mapper, structure_loss, graphs)
            losses["total"].backward()
            found.append((losses["total"].detach(), {n: p.grad.clone() for n, p in network.named_parameters()
                                                     if p.grad is not None}))
        torch.testing.assert_close(*found, atol=1e-3, rtol=1e-2)


@pytest.mark.parametrize("name", SCENES)
def test_a_mirrored_sample_is_that_of_a_mirrored_world(tmp_path, name):
    scene = SCENES[name]
    x = np.float32((-1, 1, 1))
    other = replace(scene, triangles=scene.triangles * x, normals=scene.normals * x, beam_axis=scene.beam_axis * x)
    if scene.volumes is not None:
        v = scene.volumes
        other = replace(other, volumes=replace(
            v, position=v.position * x, rotation=v.rotation * np.float32((1, -1, -1)),
            density=v.density.reshape(-1, 4, 4, 4)[..., ::-1].reshape(-1, 64).copy()))
    if scene.environment is not None:
        other = replace(other, environment=np.roll(scene.environment[:, ::-1], 256, axis=1).copy())
    sample, expected = (build_sample(write(tmp_path / f"scene_{i}.npz", one), LightInputs.SCENE)
                        for i, one in enumerate((scene, other)))
    # What the camera sees of it is symmetric, but for the light that was written.
    fields = [part for part in _flatten(expected) if not part.startswith(("image", "finished", "direct", "indirect"))]
    found, wanted = _flatten(mirrored(sample)), _flatten(expected)
    for part in fields:
        torch.testing.assert_close(found[part], wanted[part], atol=3e-3, rtol=1e-2, msg=lambda m, p=part: f"{p}: {m}")
    assert torch.equal(mirrored(sample).image, sample.image.flip(-1)) and not torch.equal(sample.image,
                                                                                       sample.image.flip(-1))


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.7])
def test_a_resized_sample_is_seen_from_farther_and_its_angles_stay(tmp_path, samples, factor):
    sample, other = samples[1], resized(samples[1], factor)
    torch.testing.assert_close(resized(other, 1 / factor).view.surface, sample.view.surface, atol=1e-3, rtol=1e-3)
    origin, rays, covered = other.view.origin, other.view.directions, other.view.surface[:, SURFACE["alpha"]] > 0
    bundles = other.view.positions.unflatten(1, (8, 8)).movedim(-1, 1).repeat_interleave(8, 2).repeat_interleave(8, 3)
    hits = uncontracted((bundles + other.view.surface[:, SURFACE["offset"]] / OFFSET_SCALE).movedim(1, -1))
    ahead = torch.nn.functional.normalize(hits - origin[:, None, None], dim=-1)
    assert ((ahead * rays).sum(-1)[covered[:, 0]] > 0.9999).all() and covered.any()
    lamp = other.inputs.triangles[other.inputs.is_light].mean((0, 1))
    nearness = other.view.emitters[:, 0, EMITTER["nearness"]].squeeze(1)[covered[:, 0]]
    torch.testing.assert_close(nearness, 1 / (1 + (lamp - hits[covered[:, 0]]).norm(dim=-1)), atol=1e-3, rtol=1e-3)
    cells, before = other.inputs.volumes, sample.inputs.volumes
    torch.testing.assert_close(cells.scale * cells.scattering, before.scale * before.scattering)


def test_steps_of_no_whole_number_of_batches_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["network", "--data", str(tmp_path), "--out", str(tmp_path / "out"), "--steps", "1",
                                     "--batch", "2", "--scenes-per-step", "3"])
    assert main() == 2
    assert "no whole number of batches of 2" in capsys.readouterr().err


def test_graphs_are_refused_where_there_are_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["network", "--data", str(tmp_path), "--out", str(tmp_path / "out"), "--steps", "1",
                                     "--batch", "2", "--capture", "400", "--device", "cpu"])
    assert main() == 2
    assert "--capture is for one process" in capsys.readouterr().err
