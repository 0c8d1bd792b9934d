# SPDX-License-Identifier: GPL-3.0-or-later
"""One point of the benchmark in a process of its own: python -m tools.benchmark.point JSON prints a JSON object.

Input: subject ("cycles", "rf2_small" or "rf2_200m"), triangles, resolution, samples, precision, threads (0: all).
"""
from __future__ import annotations

import json
import sys
import time
import traceback

import numpy as np

from .. import extension
from . import ring

SEED = 0


def main() -> None:
    point = json.loads(sys.argv[1])
    from ..common.console import silence_blender
    silence_blender()
    measure = {"cycles": cycles, "rf2_small": rf2_small, "rf2_200m": rf2_200m}[point["subject"]]
    result = measure(point)
    from renderformer_v2.rf2_engine.progress.memory import MEBI, held
    result["peak_bytes"] = round(held()[1] * MEBI)
    print(json.dumps(result))
    extension.leave(0)


def cycles(point: dict) -> dict:
    """Seconds of a render with `samples` samples per pixel, not adaptive, not denoised: synchronisation included."""
    scene = _scene(point)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = point["samples"]
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    return {"seconds": _render(scene)}


def rf2_small(point: dict) -> dict:
    """Seconds of F12 with the bundled network: conversion, guides and network, without loading the weights."""
    extension.load().register()
    scene = _scene(point)
    scene.render.engine = "RENDERFORMER_V2"
    settings = scene.renderformer_v2
    settings.token_budget, settings.max_edge, settings.precision = point["triangles"], 1.0, point["precision"]
    settings.light = "NETWORK"
    total = _render(scene)
    from renderformer_v2.model.weights.presets import rf2_small as preset
    from renderformer_v2.rf2_engine.progress.last_render import last_frame
    (last,) = last_frame
    return {"seconds": total - last.seconds.get("Loading the network", 0.0), "real_triangles": last.triangles,
            "tokens": last.tokens} | _efficiency(preset(), last.triangles, point, last.seconds["Network"])


def rf2_200m(point: dict) -> dict:
    """Seconds of the forward with random weights: stage 1, then a first view with its keys and values."""
    import torch

    from renderformer_v2.model.camera import square_view
    from renderformer_v2.model.compute.devices import choose_device
    from renderformer_v2.model.compute.precision import choose_precision
    from renderformer_v2.model.network.inputs import view_inputs
    from renderformer_v2.model.network.layers import in_precision
    from renderformer_v2.model.network.renderformer import RenderFormer
    from renderformer_v2.model.weights.presets import rf2_200m as preset
    device = choose_device()
    torch.manual_seed(SEED)
    model = in_precision(RenderFormer(preset()), choose_precision(point["precision"], device)).to(device).eval()

    def view(resolution: int):
        return view_inputs(square_view(ring.camera_to_world(), ring.FIELD_OF_VIEW, resolution)).to(device)

    rays, inputs = view(point["resolution"]), random_inputs(point["triangles"], preset()).to(device)
    with torch.inference_mode():
        model(random_inputs(ring.LEAST, preset()).to(device), view(64))[0, 0, 0, 0].item()  # warm up
        begin = time.perf_counter()
        context = model.encode_scene(inputs)
        context.tokens[0, 0].item()
        stage1 = time.perf_counter() - begin
        model.render_view(context, rays)[0, 0, 0, 0].item()
        total = time.perf_counter() - begin
    count = len(inputs.light)
    return {"seconds": total, "stage1_seconds": stage1, "stage2_seconds": total - stage1, "real_triangles": count,
            "tokens": len(context.tokens)} | _efficiency(preset(), count, point, total)


def random_inputs(triangles: int, config):
    """The scene's geometry with random texture and environment latents, which cost what real ones cost."""
    import torch

    from renderformer_v2.model.geometry import area_vectors
    from renderformer_v2.model.network.embedding import ENVIRONMENT_GRID
    from renderformer_v2.model.network.inputs import EnvironmentInputs, NetworkInputs, encode_light
    corners, lamp = ring.triangle_corners(triangles)
    normal = area_vectors(corners)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sides = [count * config.envmap_latent_patch_size for count in ENVIRONMENT_GRID]
    panorama = torch.randn(2, config.envmap_latent_channels, *sides)
    texture = torch.randn(len(corners), config.texture_channels, *[config.texture_encode_patch_size] * 2)
    return NetworkInputs(
        torch.from_numpy(corners), torch.from_numpy(np.repeat(normal[:, None], 3, axis=1)), texture,
        torch.arange(len(corners)),
        encode_light(torch.from_numpy(lamp * ring.RADIANCE)[:, None].expand(-1, 3)),
        EnvironmentInputs(*panorama, torch.zeros(1)))


def _efficiency(config, triangles: int, point: dict, seconds: float) -> dict:
    """FLOPs by formula, and how they compare with the large matrix products of this machine in the same format."""
    from renderformer_v2.model.compute.devices import choose_device
    from renderformer_v2.model.compute.precision import choose_precision

    from .flops import forward_flops, product_rate, stage1_flops
    device = choose_device()
    dtype = choose_precision(point["precision"], device)
    flops = forward_flops(config, triangles, ring.LAMP, point["resolution"])
    total, rate = sum(flops.values()), product_rate(device, dtype)
    return {"precision": str(dtype).removeprefix("torch."), "device": device.type, "flops": total,
            "stage1_flops": stage1_flops(flops), "product_flops_per_s": rate, "efficiency": total / seconds / rate}


def _scene(point: dict):
    import bpy
    ring.build(point["triangles"], point["resolution"])
    scene = bpy.context.scene
    if point["threads"]:
        scene.render.threads_mode, scene.render.threads = "FIXED", point["threads"]
    return scene


def _render(scene) -> float:
    import bpy
    begin = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    return time.perf_counter() - begin


if __name__ == "__main__":
    try:
        main()
    except Exception:
        traceback.print_exc()
        extension.leave(1)
