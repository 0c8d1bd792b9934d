# SPDX-License-Identifier: GPL-3.0-or-later
"""Running out of memory: the libraries' real errors, raised where the network works."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.frame import render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import failure

from tests.rf2_engine.f12 import cube, press_f12

TOO_MUCH = 1 << 60


def with_torch():
    import torch
    torch.empty(TOO_MUCH, dtype=torch.uint8)


def with_numpy():
    np.ones(TOO_MUCH, np.uint8)


def with_python():
    bytearray(TOO_MUCH)


@pytest.mark.parametrize("allocate", [with_torch, with_numpy, with_python])
def test_out_of_memory_is_said_with_the_settings_to_lower(scene, tmp_path, monkeypatch, allocate):
    cube(scene)
    monkeypatch.setattr(render.model_cache, "encoded", lambda *_: allocate())
    press_f12(scene, tmp_path, may_fail=True)
    (layer,) = last_render.last_frame
    assert layer.error.startswith("Out of memory: lower Max Triangles or the resolution")
    assert "Device" not in layer.error


def gpu_errors():
    import torch
    yield torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")
    yield RuntimeError("MPS backend out of memory (MPS allocated: 8.0 GB, other allocations: 1.0 GB, max allowed: 9.0)")
    yield RuntimeError("CUDA error: out of memory")
    yield RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`")


def test_out_of_memory_on_a_gpu_also_offers_the_processor():
    for error in gpu_errors():
        text = failure.message(error)
        assert text.startswith("Out of memory") and "set Device to CPU" in text


def test_any_other_error_is_a_fault_of_ours(capfd):
    assert failure.message(RuntimeError("mat1 and mat2 shapes cannot be multiplied")).startswith("Internal error")
    assert "shapes cannot be multiplied" in capfd.readouterr().err
