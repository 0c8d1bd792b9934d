# SPDX-License-Identifier: GPL-3.0-or-later
"""What encoding textures for the published weights costs.

    python -m tools.benchmark.textures [--triangles N] [--device D]

The image encoder has the published size and random weights, which cost the same. Prints a line of JSON: seconds of an
image by itself as the authors' code encodes it (a video of one frame, in float32) and as a render does; its
multiplications, and those in 3x3 convolutions of stride 1; the rate of the latter way as a share of large matrix
products' in the same format; and seconds of a scene of N triangles, each with a texture of its own (three images), at
the first render and at a later one. On a processor the seconds of an image are those of its cores together, which other
programs disturb less.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from renderformer_v2.model.compute.devices import choose_device, device_name
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.compute.precision import NAMES, choose_precision
from renderformer_v2.model.material.mappers import MAPPERS, Appearance
from renderformer_v2.model.published.image_encoder import BATCH_CPU, ImageEncoder, LastTap, OneFrameEncoder, vae_class
from renderformer_v2.model.published.latent_store import LatentStore
from renderformer_v2.model.published.scene_encoder import SceneEncoder
from renderformer_v2.model.scene import BASE_COLOR, TILE_SIZE, RenderScene, constant_tile
from tools.benchmark.flops import product_rate
from tools.common.console import whole_number

SIZES = {"hidden_dim": 128, "num_layers": 3, "latent_dim": 9}  # of a mapper
SEED, ALONE = 0, 2 * BATCH_CPU  # images encoded by themselves


def measure(triangles: int, device: torch.device, vae: nn.Module | None = None) -> dict:
    """vae: the published size with random weights if not given."""
    torch.manual_seed(SEED)
    dtype, vae = choose_precision("auto", device), vae or vae_class()()
    images = torch.rand(ALONE, 3, TILE_SIZE, TILE_SIZE) * 2 - 1
    with inference(), tempfile.TemporaryDirectory() as folder:
        vae.save_pretrained(folder)
        vae = vae.to(device).eval()
        video_seconds = _time_image(lambda x: vae.encode(x[:, :, None]).latent_dist.mean, images.to(device))
        measurement = {"device": device_name(device), "threads": torch.get_num_threads(), "precision": NAMES[dtype],
                       "video_seconds": video_seconds}
        chosen = ImageEncoder(Path(folder), device, dtype).dtype
        frame = OneFrameEncoder(vae).to(device, chosen, memory_format=torch.channels_last)
        measurement["image_seconds"] = _time_image(lambda x: frame(x.to(chosen)), images.to(device))
        measurement |= count_multiplications(frame, images[:1].to(device, chosen))
        rate = product_rate(device, chosen, clock=_choose_clock(device))
        measurement["product_share"] = round(
            2 * measurement["multiplications"] / measurement["image_seconds"] / rate, 2)
        mappers = [MAPPERS[name](**SIZES).to(device).eval() for name in MAPPERS]
        scene, file = make_textured_scene(triangles), Path(folder) / "latents.sqlite"
        for when in ("first", "later"):
            scene_encoder = SceneEncoder(Appearance(*mappers), ImageEncoder(Path(folder), device, dtype),
                                         LatentStore(file))
            begin = time.perf_counter()
            scene_encoder.process(scene)
            measurement[f"{when}_seconds"] = round(time.perf_counter() - begin, 3)
    times = round(measurement["video_seconds"] / measurement["image_seconds"], 2)
    return measurement | {"triangles": triangles, "times": times}


def count_multiplications(frame: OneFrameEncoder, image: torch.Tensor) -> dict[str, int]:
    """Multiplications for a (1, 3, H, W) image: all, and those that Winograd's methods apply to."""
    with FlopCounterMode(display=False) as counter:
        frame(image)
    counts = {name.partition(".")[2]: sum(flops.values()) // 2 for name, flops in counter.get_flop_counts().items()}
    square = sum(counts[name] for name, layer in frame.named_modules()
                 if isinstance(layer, LastTap) and layer.weight.shape[-1] == 3)
    return {"multiplications": counter.get_total_flops() // 2, "multiplications_3x3": square}


def make_textured_scene(triangles: int) -> RenderScene:
    """Triangles whose colours change smoothly, in another way on each of them."""
    random = np.random.default_rng(SEED)
    tiles = np.repeat(constant_tile((0.5, 0.5, 0.5), roughness=0.5, ior=1.5)[None], triangles, axis=0)
    slope = np.linspace(0, 0.5, TILE_SIZE, dtype=np.float16)
    base, change = random.random((triangles, 3, 1, 1)) / 2, random.random((triangles, 1, 1, 1))
    tiles[:, BASE_COLOR] = base + slope[:, None] * change
    rows = np.zeros((triangles, 3), np.float32)
    corners = random.random((triangles, 3, 3)).astype(np.float32)
    normals = np.tile(np.float32((0, 0, 1)), (triangles, 3, 1))
    return RenderScene(corners, normals, rows, rows, rows[:, :2], np.arange(triangles, dtype=np.int32), tiles)


def _time_image(encode, images: torch.Tensor) -> float:
    """Seconds of an image, the best of two runs."""
    best, clock = float("inf"), _choose_clock(images.device)
    for _ in range(2):
        begin = clock()
        for batch in images.split(BATCH_CPU):
            encode(batch).float().cpu()
        best = min(best, clock() - begin)
    return round(best / len(images), 5)


def _choose_clock(device: torch.device):
    return time.process_time if device.type == "cpu" else time.perf_counter


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark.textures", description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=whole_number(1), default=512)
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda, cuda:1 or mps")
    arguments = parser.parse_args()
    try:
        print(json.dumps(measure(arguments.triangles, choose_device(arguments.device))))
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
