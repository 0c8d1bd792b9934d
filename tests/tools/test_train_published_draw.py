# SPDX-License-Identifier: GPL-3.0-or-later
"""What training sees of published samples: turned and recoloured copies, some views, crops, moved scenes."""
import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.environment import direction_map
from renderformer_v2.model.fields import COLOR, PANORAMA, map_arrays
from renderformer_v2.model.geometry import rotation_matrix
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.tools.test_finetune import options
from tests.tools.test_train_ranks import write
from tools.datagen.sample_files import load_sample, save_sample
from tools.train import published, published_samples
from tools.train.augment import for_numpy, recolored, resampled, rotation, turned
from tools.train.config import Stage, TrainConfig
from tools.train.errors import TrainingError
from tools.train.published_draw import Drawn, cropped, moved, with_views
from tools.train.published_samples import Encoded, build_copy, build_sample
from tools.train.sample_cache import _flatten

TURN = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # a third of a turn: boxes stay aligned with the axes
ORDER = torch.tensor([2, 0, 1])
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

    cameras = [TURN.numpy() @ view.camera_to_world[:3] for view in views]
    seen = [replace(view, camera_to_world=np.vstack([camera, [0, 0, 0, 1]]).astype(np.float32))
            for view, camera in zip(views, cameras)]
    channels = [*ORDER.tolist(), 3]
    swapped = [{name: image[..., channels[:image.shape[-1]]] for name, image in found.items()} for found in passes]
    changes = turned(TURN) | {COLOR: recolored(ORDER), PANORAMA: resampled(TURN)}
    world = tmp_path / "scene_9.npz"
    save_sample(world, map_arrays(scene, for_numpy(changes)), seen, guides, swapped)

    monkeypatch.setattr(published_samples, "symmetry_of", lambda path, copy, recolors: (TURN, ORDER))
    sample = build_sample(path, pipeline)
    assert_same(build_copy(path, pipeline, 1).of(sample), build_sample(world, pipeline))
    with pytest.raises(AssertionError):
        assert_same(sample, build_sample(world, pipeline))


def test_copies_differ_but_not_from_run_to_run(tmp_path):
    path = tmp_path / "scene_1.npz"
    drawn = [published_samples.symmetry_of(path, copy, True) for copy in range(1, 9)]
    again = [published_samples.symmetry_of(path, copy, True) for copy in range(1, 9)]
    assert all(torch.equal(turn, other) for (turn, _), (other, _) in zip(drawn, again))
    assert len({tuple(turn.flatten().tolist()) for turn, _ in drawn}) == 8
    assert len({tuple(order.tolist()) for _, order in drawn}) > 2
    assert min(turn[2, 2] for turn, _ in drawn) < 0.9, "not only about Z"
    assert published_samples.symmetry_of(path, 3, False)[1].tolist() == [0, 1, 2]


def test_a_panorama_turns_with_the_world():
    """What shone from a direction shines from the turned one."""
    turn, directions = rotation(torch.tensor([0.4, -1.1, 0.7])), torch.from_numpy(direction_map(256, 512))
    assert torch.allclose(turn @ turn.T, torch.eye(3), atol=1e-6) and torch.det(turn) == pytest.approx(1)
    axis = torch.tensor([0.4, -1.1, 0.7])
    torch.testing.assert_close(turn @ axis, axis)
    after = resampled(turn)(directions.movedim(-1, -2)).movedim(-1, -2)  # a map that shows where it is seen
    inside = directions[..., 0] > -0.99  # of the seam, where interpolation is clamped
    error = (after @ turn.T - directions).norm(dim=-1)
    assert error.median() < 1e-3 and error[inside].quantile(0.99) < 0.02


@pytest.mark.parametrize("seed, turns", [(2, False), (3, True)])
def test_scenes_without_an_environment_turn_as_a_whole_at_every_step(tmp_path, pipeline, seed, turns):
    write(tmp_path, seed)
    path, generator = tmp_path / f"scene_{seed:08d}.npz", torch.Generator().manual_seed(0)
    encoded = Encoded(tmp_path / "cache", pipeline, copies=2)
    encoded.prepare(tmp_path, pipeline)
    seen = [Drawn(encoded, Stage(1), 64, 0.0)(path, generator) for _ in range(6)]
    places = {tuple(sample.inputs.triangles[0, 0].tolist()) for sample in seen}
    assert len(places) == (6 if turns else 2)

    def relations(sample):
        """Numbers that no rotation changes: of normals, corners and cells with the rays of the camera."""
        inputs, (origin, directions) = sample.inputs, (sample.rays.origin[0], sample.rays.directions[0, ::16, ::16])
        corners, cells = inputs.triangles - origin, inputs.volumes
        yield torch.einsum("nci,hwi->nchw", inputs.normals, directions)
        yield torch.einsum("nci,hwi->nchw", corners, directions)
        yield torch.einsum("nci,nci->nc", corners, inputs.normals)
        if cells is not None:
            axes = torch.tensor(np.array([rotation_matrix(euler) for euler in cells.rotation.numpy()]))
            yield torch.einsum("mij,hwi->mhwj", axes.float(), directions)
            yield torch.einsum("mi,hwi->mhw", cells.position - origin, directions)

    for sample in seen[1:]:
        for found, expected in zip(relations(sample), relations(seen[0]), strict=True):
            torch.testing.assert_close(found, expected, rtol=0, atol=4e-3)  # half precision in the cache


def test_a_crop_has_the_rays_of_the_whole_camera(tmp_path, pipeline):
    write(tmp_path, 1)
    sample = build_sample(tmp_path / "scene_00000001.npz", pipeline)
    rows, columns = torch.meshgrid(torch.arange(256.0), torch.arange(192.0), indexing="ij")
    pixel = torch.stack([rows, columns, rows * columns])[None].repeat(3, 1, 1, 1)
    sample = replace(sample, rays=replace(sample.rays, origin=torch.eye(3), directions=pixel.movedim(1, -1)),
                     image=pixel, mask=pixel[:, :1] > 100)
    starts = set()
    for seed in range(20):
        small = cropped(sample, 128, 64, torch.Generator().manual_seed(seed))
        assert small.image.shape == (3, 3, 128, 128) and torch.equal(small.rays.directions.movedim(-1, 1), small.image)
        assert torch.equal(small.mask, small.image[:, :1] > 100) and torch.equal(small.rays.origin, torch.eye(3))
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
