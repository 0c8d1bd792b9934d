# SPDX-License-Identifier: GPL-3.0-or-later
"""What a device does with the published network's sizes, in about a minute and to be pasted: tools.benchmark --device.

The weights are random, so no picture means anything, but half precision has to give what float32 does.
"""
from __future__ import annotations

import platform
import time

import torch

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.compute.devices import choose_device, device_name, explain_unused_card, free_memory
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.compute.precision import NAMES, choose_precision, find_failure, tensor_float_32
from renderformer_v2.model.network.inputs import view_inputs
from renderformer_v2.model.network.renderformer import RenderFormer, store_as_released
from renderformer_v2.model.weights.presets import rf2_200m

from . import ring
from .flops import product_rate
from .point import SEED, random_inputs

TRIANGLES, RESOLUTION = 4096, 512


def measure(name: str, precision: str = "auto", triangles: int = TRIANGLES, resolution: int = RESOLUTION,
            config=None) -> dict:
    """The device and its numbers. Raises ValueError for a device that is not there."""
    device, config = choose_device(name), config or rf2_200m()
    dtype = choose_precision(precision, device)
    measurement = {"device": device_name(device), "torch": torch.__version__, "cuda": torch.version.cuda,
                   "system": f"{platform.system()} {platform.machine()}", "threads": torch.get_num_threads(),
                   "precision": NAMES[dtype], "precision_fails": find_failure(dtype, device),
                   "unused_card": explain_unused_card(),
                   "free_bytes": free_memory(device), "triangles": triangles, "resolution": resolution}
    if measurement["precision_fails"]:
        return measurement
    torch.manual_seed(SEED)
    network = RenderFormer(config).to(device).eval()
    inputs = random_inputs(triangles, config).to(device)
    rays = view_inputs(square_view(ring.camera_to_world(), ring.FIELD_OF_VIEW, resolution)).to(device)
    exact = None
    if dtype != torch.float32:
        exact, seconds = _time_stages(network, inputs, rays, device)
        measurement |= {f"float32_{key}": value for key, value in seconds.items()}
    network = store_as_released(network, dtype, device)
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
    _time_stages(network, inputs, rays, device)  # warm up
    picture, seconds = _time_stages(network, inputs, rays, device)
    measurement |= seconds | {"finite": bool(picture.isfinite().all()),
                              "product_flops_per_s": product_rate(device, dtype)}
    if exact is not None:
        measurement["rms_error"] = float((picture - exact).square().mean().sqrt() / exact.square().mean().sqrt())
    if device.type == "cuda":
        measurement["peak_bytes"] = torch.cuda.max_memory_allocated(device)
    return measurement


@inference()
def _time_stages(network: RenderFormer, inputs, rays, device: torch.device) -> tuple[torch.Tensor, dict[str, float]]:
    """The picture, on the CPU, and the seconds of both stages."""
    begin = time.perf_counter()
    context = network.encode_scene(inputs)
    context.tokens[0, 0].item()
    middle = time.perf_counter()
    with tensor_float_32(device):
        picture = network.render_view(context, rays).float().cpu()
    return picture, {"stage1_seconds": round(middle - begin, 3),
                     "stage2_seconds": round(time.perf_counter() - middle, 3)}
