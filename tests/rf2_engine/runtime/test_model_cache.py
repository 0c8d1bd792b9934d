# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept between renders, and when it is made again."""
import os
import shutil

import numpy as np
import pytest
import torch

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.scene import RenderScene, constant_tile
from bl_ext.user_default.renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache


@pytest.fixture(autouse=True)
def empty():
    model_cache.free()
    yield
    model_cache.free()


def small_scene(brightness: float) -> RenderScene:
    triangles = np.float32([[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 0, 2), (0, 1, 2), (1, 0, 2)]])
    emission = np.float32([(0, 0, 0), (brightness,) * 3])
    return RenderScene(triangles, np.tile(np.float32((0, 0, 1)), (2, 3, 1)), emission, np.zeros((2, 3), np.float32),
                       np.zeros((2, 2), np.float32), np.zeros(2, np.int32), constant_tile()[None])


def test_weights_replaced_on_disk_are_loaded_again(tmp_path):
    folder = tmp_path / "weights"
    shutil.copytree(weights_folder(BUNDLED), folder)
    first = model_cache.renderer(str(folder), "cpu", "fp32")
    assert model_cache.renderer(str(folder), "cpu", "fp32") is first
    file = folder / "model.safetensors"
    os.utime(file, ns=(1, file.stat().st_mtime_ns + 1_000_000))
    assert model_cache.renderer(str(folder), "cpu", "fp32") is not first


def test_stage_one_is_kept_until_the_scene_changes():
    renderer, said = model_cache.renderer(BUNDLED, "cpu", "fp32"), []
    first = model_cache.encoded(renderer, small_scene(5), 64)
    with progress.reporting(lambda text, fraction: said.append(text)):
        assert model_cache.encoded(renderer, small_scene(5), 64) is first
        assert not said
        assert model_cache.encoded(renderer, small_scene(6), 64) is not first
    assert any(text.startswith("Estimating bounced light") for text in said)


def test_freeing_forgets_network_and_scene():
    renderer = model_cache.renderer(BUNDLED, "cpu", "fp32")
    model_cache.encoded(renderer, small_scene(5), 64)
    model_cache.free()
    assert not model_cache.is_loaded() and not model_cache._encoded


@pytest.mark.parametrize("gpu, found", [("cuda", "cuda.is_available"), ("mps", "backends.mps.is_available")])
def test_freeing_gives_the_memory_of_gpus_back(monkeypatch, gpu, found):
    given_back = []
    model_cache.renderer(BUNDLED, "cpu", "fp32")
    for name in ("cuda.is_available", "backends.mps.is_available"):
        monkeypatch.setattr(f"torch.{name}", lambda name=name: name == found)
    monkeypatch.setattr(f"torch.{gpu}.empty_cache", lambda: given_back.append(gpu))
    model_cache.free()
    assert given_back == [gpu]


def test_a_network_on_the_processor_takes_no_memory_of_a_gpu(monkeypatch):
    renderer = model_cache.renderer(BUNDLED, "cpu", "fp32")
    model_cache.leave_gpu()
    assert model_cache.is_loaded()
    monkeypatch.setattr(renderer, "device", torch.device("cuda"))
    model_cache.leave_gpu()
    assert not model_cache.is_loaded()
