# SPDX-License-Identifier: GPL-3.0-or-later
"""What training sees of published samples: turned and recoloured copies, some views, crops, moved scenes."""
import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.fields import map_arrays
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.tools.test_finetune import options
from tests.tools.test_train_ranks import write
from tools.datagen.sample_files import load_sample, save_sample
from tools.train import published, published_samples
from tools.train.augment import for_numpy, symmetry, turn_about_z
from tools.train.config import Stage, TrainConfig
from tools.train.errors import TrainingError
from tools.train.published_draw import cropped, moved, with_views
from tools.train.published_samples import build_sample
from tools.train.sample_cache import _flatten

QUARTER, ORDER = 0.25, torch.tensor([2, 0, 1])
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory) -> Path:
    return write_bundle(tmp_path_factory.mktemp("published") / "renderformer-v2", tiny_published_config())


@pytest.fixture(scope="module")
def pipeline(bundle) -> PublishedPipeline:
    return PublishedPipeline(bundle, CPU, torch.float32)


def assert_same(found, expected) -> None:
    found, expected = _flatten(found), _flatten(expected)
    assert found.keys() == expected.keys()
    for name in expected:
        torch.testing.assert_close(found[name], expected[name], rtol=1e-3, atol=2e-3, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.parametrize("seed", [2, 3])
def test_a_copy_is_the_sample_of_a_turned_and_recoloured_world(tmp_path, monkeypatch, pipeline, seed):
    write(tmp_path, seed)
    path = tmp_path / f"scene_{seed:08d}.npz"
    scene, views, guides, passes = load_sample(path)
    scene.tiles[:, :3] = np.random.default_rng(0).random(scene.tiles[:, :3].shape)
    save_sample(path, scene, views, guides, passes)
    scene, views, guides, passes = load_sample(path)

    turn = turn_about_z(np.pi / 2)
    cameras = [turn(torch.from_numpy(view.camera_to_world[:3].T.copy())).T.numpy() for view in views]
    turned = [replace(view, camera_to_world=np.vstack([camera, [0, 0, 0, 1]]).astype(np.float32))
              for view, camera in zip(views, cameras)]
    channels = [*ORDER.tolist(), 3]
    swapped = [{name: image[..., channels[:image.shape[-1]]] for name, image in found.items()} for found in passes]
    world = tmp_path / "scene_9.npz"
    save_sample(world, map_arrays(scene, for_numpy(symmetry(QUARTER, ORDER))), turned, guides, swapped)

    monkeypatch.setattr(published_samples, "symmetry_of", lambda path, copy, recolors: (QUARTER, ORDER))
    assert_same(build_sample(path, pipeline, 1), build_sample(world, pipeline))
    with pytest.raises(AssertionError):
        assert_same(build_sample(path, pipeline, 0), build_sample(world, pipeline))


def test_copies_differ_but_not_from_run_to_run(tmp_path):
    path = tmp_path / "scene_1.npz"
    drawn = [published_samples.symmetry_of(path, copy, True) for copy in range(1, 9)]
    again = [published_samples.symmetry_of(path, copy, True) for copy in range(1, 9)]
    assert [turns for turns, _ in drawn] == [turns for turns, _ in again]
    assert len({turns for turns, _ in drawn}) == 8 and len({tuple(order.tolist()) for _, order in drawn}) > 2
    assert published_samples.symmetry_of(path, 3, False)[1].tolist() == [0, 1, 2]


def test_a_crop_has_the_rays_of_the_whole_camera(tmp_path, pipeline):
    write(tmp_path, 1)
    sample = build_sample(tmp_path / "scene_00000001.npz", pipeline)
    rows, columns = torch.meshgrid(torch.arange(256.0), torch.arange(192.0), indexing="ij")
    pixel = torch.stack([rows, columns, rows * columns])[None].repeat(3, 1, 1, 1)
    sample = replace(sample, rays=replace(sample.rays, origin=torch.eye(3), directions=pixel.movedim(1, -1)),
                     image=pixel, shown=pixel[:, :1] > 100)
    starts = set()
    for seed in range(20):
        small = cropped(sample, 128, 64, torch.Generator().manual_seed(seed))
        assert small.image.shape == (3, 3, 128, 128) and torch.equal(small.rays.directions.movedim(-1, 1), small.image)
        assert torch.equal(small.shown, small.image[:, :1] > 100) and torch.equal(small.rays.origin, torch.eye(3))
        starts |= {tuple(view[:2, 0, 0].tolist()) for view in small.image}
        assert torch.equal(small.image[0, :2] - small.image[0, :2, :1, :1], pixel[0, :2, :128, :128])
    assert starts == {(y, x) for y in (0, 64, 128) for x in (0, 64)}
    assert cropped(sample, 512, 64, torch.Generator()).image.shape == sample.image.shape
    assert with_views(sample, torch.tensor([2, 0])).rays.origin.tolist() == [[0, 0, 1], [1, 0, 0]]


def test_a_moved_scene_looks_the_same(tmp_path, pipeline):
    write(tmp_path, 3)
    sample = build_sample(tmp_path / "scene_00000003.npz", pipeline)
    other = moved(sample, torch.tensor([0.3, -0.2, 0.1]))
    network = pipeline.load("transformer_512")
    with torch.no_grad():
        before, after = (network(one.inputs, one.rays) for one in (sample, other))
    torch.testing.assert_close(other.rays.origin - sample.rays.origin, torch.tensor([[0.3, -0.2, 0.1]]))
    torch.testing.assert_close(after, before, rtol=1e-2, atol=1e-3)


def settings(**more) -> TrainConfig:
    return replace(TrainConfig.load(Path(published.__file__).with_name("published.json")), **more)


def test_training_draws_copies_views_and_crops(tmp_path, bundle):
    write(tmp_path / "data", 1)
    chosen = settings(copies=3, offset=0.25, recomputed=("transformer.", "view_transformer."),
                      stages=(Stage(1, views=1, crop=64),))
    for steps in (1, 2):
        published.train(options(tmp_path, bundle, minutes=None, steps=steps), chosen)
        assert len(list((tmp_path / "run" / "cache").iterdir())) == 3
    lines = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [1, 2] and lines[-1]["skipped"] == 0


@pytest.mark.parametrize("more", [{"copies": 0}, {"stages": (Stage(1, crop=100),)}])
def test_crops_and_copies_that_cannot_be_are_said(tmp_path, bundle, more):
    write(tmp_path / "data", 1)
    chosen = argparse.Namespace(**vars(options(tmp_path, bundle)), config=Path("mine.json"))
    with pytest.raises(TrainingError, match="mine.json: copies must be at least 1, and crop a multiple of 64"):
        published.train(chosen, settings(**more))
