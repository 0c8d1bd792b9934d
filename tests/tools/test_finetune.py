# SPDX-License-Identifier: GPL-3.0-or-later
"""Fine-tuning: samples of the user's own files, and a published bundle that learns while its other files stay."""
import argparse
import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.network.inputs import view_inputs
from renderformer_v2.model.network.renderformer import to_radiance
from renderformer_v2.model.published.pipeline import PublishedPipeline
from renderformer_v2.model.renderer import Renderer
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.model.samples import floor_scene, floor_view
from tests.tools.test_train_network import write
from tools.benchmark import ring
from tools.benchmark.point import random_inputs
from tools.datagen.sample_files import load_sample, sample_paths
from tools.train import published
from tools.train.config import TrainConfig
from tools.train.errors import TrainingError
from tools.train.losses import structure_loss
from tools.train.new_bundle import new_transformer
from tools.train.published_samples import build_sample, picture_size
from tools.train.state import TrainingState

ROOT = Path(__file__).parents[2]
MAKE = """
import bpy
from mathutils import Vector
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
bpy.ops.mesh.primitive_plane_add(size=4)
bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 0.5))
bpy.ops.object.light_add(type="SUN", location=(0, 0, 3))
if {camera}:
    bpy.ops.object.camera_add(location=(3, -3, 2))
    scene.camera = bpy.context.object
    scene.camera.rotation_euler = (Vector((0, 0, 0.5)) - scene.camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.camera.data.dof.use_dof = True
    scene.timeline_markers.new("cut", frame=1).camera = scene.camera
    if {animated}:
        for scene.camera.location.x, frame in ((3, 1), (2, 20)):
            scene.camera.keyframe_insert("location", frame=frame)
        scene.frame_end = 20
bpy.ops.wm.save_as_mainfile(filepath={path!r})
import os
os._exit(0)
"""


def make_blend(path: Path, camera: bool = True, animated: bool = False) -> Path:
    program = MAKE.format(path=str(path), camera=camera, animated=animated)
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, timeout=600)
    return path


def digests(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob("*") if path.is_file()}


def datagen(folder: Path, *files: Path, views: int = 3) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "tools.datagen", folder, "--blend", *files, "--views", views, "--resolution", 32,
               "--samples", 2, "--equal", 1, "--hints", 3]
    return subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True, timeout=600)


def test_files_give_their_own_view_and_others_beside_it_and_stay_as_they_are(tmp_path):
    still, moving = make_blend(tmp_path / "still.blend"), make_blend(tmp_path / "moving.blend", animated=True)
    nameless, lost = make_blend(tmp_path / "blind.blend", camera=False), tmp_path / "lost.blend"
    before = digests(tmp_path)
    done = datagen(tmp_path / "samples", still, nameless, lost, moving)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert f"{nameless}: scene \"Scene\" has no camera at frame 1: add one" in done.stderr
    assert f"{lost}: there is no such file" in done.stderr
    assert {name: digest for name, digest in digests(tmp_path).items() if name in before} == before

    paths = sample_paths(tmp_path / "samples")
    samples = {path.name: load_sample(path) for path in paths}
    assert [len(sample.views) for sample in samples.values()] == [2, 1, 2, 1]
    places = {name.split("_")[1]: [] for name in samples}
    for name, (scene, views, guides, passes) in samples.items():
        scene.validate()
        places[name.split("_")[1]] += [view.camera_to_world[:3, 3] for view in views]
        assert all((guide.hit_triangle >= 0).mean() > 0.2 for guide in guides) and len(passes) == len(views)
        assert all("equal" in found for found in passes) and all((guide.samples == 3).all() for guide in guides)
    np.testing.assert_allclose(places["still"][0], [3, -3, 2], atol=1e-5)
    assert all(0.01 < np.linalg.norm(place - [3, -3, 2]) < 2 for place in places["still"][1:])
    assert abs(places["moving"][0][0] - places["moving"][2][0]) > 0.2 and places["moving"][2][1] == -3

    written = [path.stat().st_mtime_ns for path in paths]
    still.touch()
    assert datagen(tmp_path / "samples", still, moving).returncode == 0
    changed = [path.stat().st_mtime_ns != old for path, old in zip(paths, written, strict=True)]
    assert changed == ["still" in path.name for path in paths]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory) -> Path:
    return write_bundle(tmp_path_factory.mktemp("published") / "renderformer-v2", tiny_published_config())


def options(tmp_path: Path, start: Path, **more) -> argparse.Namespace:
    return argparse.Namespace(**{
        "data": tmp_path / "data", "start": start, "out": tmp_path / "run", "device": "cpu", "seed": 0, "minutes": 0.02,
        "steps": None, "cooldown": 0.0, "save_every": 1000.0, "log_every": 50, "scenes_per_step": None,
        "precision": "bf16", "compile": False, "cache": None, "workers": 1, "from_scratch": False, **more})


def test_a_published_network_learns_one_sample(tmp_path, bundle):
    write(tmp_path, 8)
    pipeline = PublishedPipeline(bundle, torch.device("cpu"), torch.float32)
    sample = build_sample(sample_paths(tmp_path)[0], pipeline)
    assert picture_size(tmp_path) == 64 and sample.image.shape == (1, 3, 64, 64)
    assert sample.mask.any() and not sample.mask.all() and not (sample.image * ~sample.mask).any()
    network = published.trainable(pipeline.load("transformer_512"))
    state, found = TrainingState(network, 3e-4, 0.0, 0.9), []
    for _ in range(8):
        found.append(published.sample_loss(network, sample, structure_loss)["total"])
        found[-1].backward()
        assert state.advance(3e-4, 1.0)
    assert found[-1] < 0.8 * found[0], found


def test_no_channel_of_a_new_network_starts_dead():
    """ELU lets a thousandth of the gradients of a negative channel pass."""
    config = tiny_published_config()
    rays = view_inputs(square_view(ring.camera_to_world(), ring.FIELD_OF_VIEW, 64))
    for seed in range(10):
        torch.manual_seed(seed)
        inputs, network = random_inputs(ring.LEAST, config), new_transformer(config)
        with torch.no_grad():
            assert (network(inputs, rays).amax((0, 2, 3)) > 0).all(), seed


def test_what_the_network_draws_below_zero_has_gradients(tmp_path, bundle):
    write(tmp_path, 8)
    pipeline = PublishedPipeline(bundle, torch.device("cpu"), torch.float32)
    sample = build_sample(sample_paths(tmp_path)[0], pipeline)
    network = published.trainable(pipeline.load("transformer_512"))
    bias = network.view_transformer.out_dpt.scratch.output_conv2[-1].bias
    torch.nn.init.constant_(bias, -9.0)
    assert (network.render_view(network.encode_scene(sample.inputs), sample.rays) < 0).all()
    published.sample_loss(network, sample, structure_loss)["total"].backward()
    assert (bias.grad < 0).all()


def test_training_sees_what_rendering_sees(tmp_path, bundle):
    write(tmp_path, 1)
    renderer = Renderer(bundle, device="cpu", precision="fp32")
    sample = build_sample(sample_paths(tmp_path)[0], renderer.pipeline)
    network = renderer.pipeline.load("transformer_512")
    with torch.no_grad():
        log_image = network.render_view(network.encode_scene(sample.inputs), sample.rays)
    seen = (to_radiance(log_image).clamp(min=0) * sample.mask)[0].movedim(0, -1).numpy()
    view, guides = floor_view()
    encoded = renderer.encode(floor_scene())
    expected = encoded.view(view, guides) * encoded.normalization.exposure
    np.testing.assert_allclose(seen, expected, rtol=2e-2, atol=2e-2 * expected.max())


def test_a_tuned_bundle_renders_and_only_the_transformer_differs(tmp_path, bundle):
    write(tmp_path / "data", 1)
    before = digests(bundle)
    config = TrainConfig.load(Path(published.__file__).with_name("published.json"))
    published.train(options(tmp_path, bundle), config)
    assert digests(bundle) == before
    tuned = digests(tmp_path / "run" / "bundle")
    changed = "transformer_512/model.safetensors"
    assert set(tuned) == set(before) and {name for name in tuned if tuned[name] != before[name]} == {changed}
    view, guides = floor_view()
    renderer = Renderer(tmp_path / "run" / "bundle", device="cpu", precision="fp32")
    assert renderer.encode(floor_scene()).view(view, guides).max() > 0
    published.train(options(tmp_path, bundle), config)  # goes on
    assert digests(bundle) == before


def test_what_cannot_be_trained_is_one_sentence(tmp_path, bundle):
    with pytest.raises(TrainingError, match="holds no samples .*--blend"):
        published.train(options(tmp_path, bundle), None)
    with pytest.raises(TrainingError, match="would be overwritten"):
        published.train(options(tmp_path, tmp_path / "run" / "bundle"), None)
    done = subprocess.run([sys.executable, "-m", "tools.train.finetune", "a.blend", "--out", str(tmp_path / "out"),
                           "--start", str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 2 and "there are no weights in" in done.stderr and "Traceback" not in done.stderr
