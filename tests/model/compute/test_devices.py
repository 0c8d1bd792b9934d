# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole pictures on a pretended Apple GPU, which refuses what a real one refuses, beside the CPU's."""
import numpy as np
import pytest
import torch

from renderformer_v2.model import pictures as bands
from renderformer_v2.model import renderer
from renderformer_v2.model.compute.devices import device_of_operator, run_operator
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.compute.threads import shared, team
from renderformer_v2.model.guided import encoders
from renderformer_v2.model.light import estimate
from renderformer_v2.model.network import decoder
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE, RenderScene, Volumes, constant_tile
from tests.model.guided.weights import busy_network, write
from tests.model.pretended_mps import pretended_mps
from tests.model.samples import flat, floor_scene, floor_view


@pytest.fixture
def pictures(monkeypatch):
    """What a function of the device makes on the pretended one and on the CPU."""
    for module in (bands, decoder, estimate, encoders):
        monkeypatch.setattr(module, "BAND_PIXELS", 1 << 11)  # half of the picture

    def both(function) -> list[np.ndarray]:
        monkeypatch.setattr(renderer, "choose_device", torch.device)  # which looks for a real one
        with pretended_mps():
            actual = function("mps")
        return [actual, function("cpu")]
    return both


@pytest.fixture
def scene() -> RenderScene:
    """A floor under a lamp, a sun and a sky, a pane of glass above it, fog, and a wall far away."""
    floor = floor_scene(side=18)  # more tokens than are computed at once
    lamp = floor.triangles[-1:]
    pane = flat(np.float32([[(-0.5, -0.5, 0.5), (0.5, -0.5, 0.5), (0, 0.5, 0.6)]]), (0.9, 0.9, 1.0))
    pane.tiles[:] = constant_tile((0.9, 0.9, 1.0), roughness=0.05, ior=1.5, transmission=1.0)
    leaf = flat(np.float32([[(0.5, 0.5, 0.3), (0.9, 0.5, 0.3), (0.7, 0.9, 0.3)]]), (1, 1, 1))
    leaf.tiles[:] = constant_tile((0.2, 0.8, 0.2), transmission=1.0)
    sun, wall = flat(lamp + np.float32((30, 0, 40)), (1, 1, 1)), flat(lamp * 4 - np.float32((9, 0, 8)), (0.5, 0.5, 0.5))
    sun.emission[:] = 900.0
    scene = floor.appended(pane, leaf, sun, wall)
    scene.box = np.float32([(-1, -1, 0), (1, 1, 1)])
    scene.environment = np.full(ENVIRONMENT_SHAPE, 0.5, np.float32)
    rows = lambda value: np.full((2, 3), value, np.float32)  # noqa: E731
    scene.volumes = Volumes(np.ones((2, 64), np.float32), np.float32([(0.3, 0, 0.4), (-0.3, 0, 0.4)]), rows(0),
                            rows(4.0), rows(0.5), rows(0.1))
    scene.validate()
    return scene


@pytest.fixture
def seen():
    """A view with everything that guides may hold."""
    view, guides = floor_view()
    guides.traced = guides.diffuse_color * 0.5
    for name in ("reflected", "refracted"):
        for kind, like in (("position", guides.position), ("normal", guides.normal), ("color", guides.diffuse_color)):
            setattr(guides, f"{name}_{kind}", like)
    guides.transmission_color = guides.diffuse_color * 0.5
    guides.refracted_light = guides.diffuse_color * 0.3
    return view, guides


def assert_same(actual: np.ndarray, expected: np.ndarray) -> None:
    """But for rounding: a GPU attends with other kernels."""
    np.testing.assert_allclose(actual, expected, rtol=1e-3, atol=1e-3 * expected.mean())


@pytest.mark.slow
def test_a_guided_network_paints_the_same_picture_on_a_gpu_that_refuses_float64(pictures, scene, seen, tmp_path):
    weights = write(tmp_path, busy_network())

    def painted(device: str) -> np.ndarray:
        view, guides = seen
        encoded = renderer.Renderer(weights, device=device, precision="fp32").encode(scene)
        lobes = encoded.lobes(view, guides)
        return encoded.antialiased({"Combined": lobes.radiance}, lobes, guides)["Combined"]

    assert_same(*pictures(painted))


def test_a_published_network_paints_the_same_picture_there(pictures, scene, seen, published_bundle):
    assert_same(*pictures(
        lambda device: renderer.Renderer(published_bundle, device=device, precision="fp32").encode(scene).view(*seen)))


def test_scenes_of_the_research_code_look_the_same_there(pictures, scene, seen, published_bundle):
    def painted(device: str) -> np.ndarray:
        pipeline = renderer.Renderer(published_bundle, device=device, precision="fp32").pipeline
        return pipeline.render_processed(pipeline.process(scene, [seen[0]]), 64)

    assert_same(*pictures(painted))


@pytest.fixture
def on_mps():
    with pretended_mps() as device:
        yield device


def test_a_gpu_works_on_one_row_after_the_other(on_mps):
    with team(2), inference():
        done = shared(lambda row: row + 1, torch.arange(4.0, device=on_mps).split(1))
    assert torch.cat(done).cpu().tolist() == [1, 2, 3, 4]


def test_what_a_gpu_lacks_is_done_on_the_cpu_by_name(on_mps):
    cpu, cuda, codes = torch.device("cpu"), torch.device("cuda"), torch.tensor([2, 1, 0]) + (1 << 47)
    assert run_operator("sort", torch.argsort, codes.to(on_mps)).cpu().tolist() == [2, 1, 0]
    assert run_operator("sort", torch.argsort, codes.to(on_mps)).device == on_mps
    assert [device_of_operator(on_mps, "grid_sampler_3d", (2, minor)) for minor in (8, 15)] == [cpu, on_mps]
    assert device_of_operator(on_mps, "add") == on_mps
    assert device_of_operator(cuda, "sort") == cuda


@pytest.mark.parametrize("refused, error", [
    (lambda x: x.double(), TypeError), (lambda x: torch.zeros(3, dtype=torch.float64).to(x.device), TypeError),
    (lambda x: torch.zeros(3, dtype=torch.float64, device=x.device), TypeError),
    (lambda x: x + torch.ones(3), RuntimeError),
    (lambda x: x.mode(), NotImplementedError), (lambda x: x.long().sort(), NotImplementedError),
    (lambda x: x.numpy(), RuntimeError)])
def test_the_pretended_gpu_refuses_what_a_real_one_refuses(on_mps, refused, error):
    x = torch.ones(3, device=on_mps)
    with pytest.raises(error):
        refused(x)
