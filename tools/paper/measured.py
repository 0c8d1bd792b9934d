# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured materials through the autoencoder: pictures of spheres become latents, and latents pictures again.

    python -m tools.paper measured SPHERE.exr ... -o DIR [--weights DIR]

The pictures are linear, of a sphere under the autoencoder's light (docs/scene-input.md 3.6). DIR gets a latent of each
(.npy, for materials in Blender), a sheet of pictures before and after, and their distances.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder, encode_picture
from renderformer_v2.model.material.mappers import LATENT_DIM
from renderformer_v2.model.material.measured_latent import AUTOENCODER
from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.published.bundle import Bundle
from renderformer_v2.model.weights.checkpoint import load_component
from tools.common.markdown import write_table
from tools.common.metrics import compare
from tools.evaluate.scores import perceptual


def main(arguments: list[str]) -> None:
    """Raises CheckpointError for a bundle without an autoencoder, ValueError for what is no picture of a sphere."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper measured", description=__doc__.splitlines()[0])
    parser.add_argument("pictures", type=Path, nargs="+", metavar="SPHERE.exr")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--weights", type=Path, metavar="DIR", help="a published bundle (default: the bundled ones)")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    autoencoder = (Bundle(options.weights).autoencoder() if options.weights
                   else load_component(MaterialAutoencoder, AUTOENCODER)).eval()
    with torch.inference_mode():
        side = autoencoder.decode(torch.zeros(1, LATENT_DIM)).shape[-1]
    table, rows = {}, []
    for path in options.pictures:
        small = resized(read_sphere(path), side)
        latent, decoded = encode_picture(autoencoder, small)
        np.save(options.output / f"{path.stem}.npy", latent)
        table[path.stem] = compare(decoded, small) | perceptual(decoded, small) | {"latent": latent.tolist()}
        rows.append(np.concatenate([small, decoded], axis=0))
    from skimage.io import imsave

    from tools.common.pictures import to_bytes
    sheet = to_bytes(linear_to_srgb(np.concatenate(rows, axis=1)))
    imsave(options.output / "measured.png", sheet, check_contrast=False)
    keys = [key for key in next(iter(table.values())) if key != "latent"]
    lines = [[name, *(f"{scores[key]:.4f}" for key in keys)] for name, scores in table.items()]
    print(write_table(options.output / "measured", ["material", *keys], lines, table), end="")


def read_sphere(path: Path) -> np.ndarray:
    """(S, S, 3) f32 linear radiance, premultiplied. Raises ValueError for a picture that is not square or not RGB."""
    import OpenEXR
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        pixels = next((channels[name].pixels for name in ("RGBA", "RGB") if name in channels), None)
    if pixels is None or pixels.shape[0] != pixels.shape[1]:
        raise ValueError(f"{path}: expected a square picture with the channels R, G and B")
    return np.nan_to_num(pixels[..., :3].astype(np.float32)).clip(0)


def resized(picture: np.ndarray, side: int) -> np.ndarray:
    """(side, side, 3) means of a square picture."""
    small = F.interpolate(torch.from_numpy(picture).movedim(-1, 0)[None], (side, side), mode="area")
    return small[0].movedim(0, -1).numpy()
