# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.measured FILE -o LATENT.npy: the appearance latent of a measured BRDF.

FILE.binary is one of the MERL database, FILE_rgb.bsdf one of the RGL material database.

Draws the sphere of the BRDF as tools.datagen.spheres renders those of Principled BSDFs, and encodes it with the
material autoencoder that the mappers of the weights belong to. LATENT.npy holds nine numbers for Material Properties >
Appearance Latent > Load Latent; LATENT.png is the sphere beside what the autoencoder makes of it.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.material.adaptive_brdf import AdaptiveBRDF
from renderformer_v2.model.material.autoencoder import MaterialAutoencoder, inverse_log10_1p, log10_1p
from renderformer_v2.model.material.measured import MeasuredBRDF, sphere_picture
from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.weights.checkpoint import load_component
from renderformer_v2.model.weights.presets import WEIGHTS
from tools.common.pictures import to_bytes, write_atomically

PANORAMA = 64, 128  # to which the studio light is reduced


def encode(picture: np.ndarray, model: MaterialAutoencoder) -> tuple[np.ndarray, np.ndarray]:
    """Of a sphere (S, S, 3): its nine numbers (9,) f32, and what the autoencoder makes of them (S, S, 3)."""
    image = log10_1p(torch.from_numpy(picture)).clamp(0, 1).permute(2, 0, 1)[None]
    with torch.no_grad():
        latent = model.encode(image)
        decoded = inverse_log10_1p(model.decode(latent))
    return latent[0].numpy(), decoded[0].permute(1, 2, 0).numpy()


def studio_panorama() -> np.ndarray:
    """(H, W) the light of tools.datagen.spheres, row 0 looking up."""
    import bpy

    from tools.datagen.scenes.own_data import resize
    from tools.datagen.spheres import load_studio_light, monochrome
    bpy.ops.wm.read_factory_settings(use_empty=True)
    image = monochrome(load_studio_light("studio"))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    return resize(pixels.reshape(height, width, 4)[::-1], *PANORAMA)[..., 0]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.measured", description=__doc__)
    parser.add_argument("brdf", type=Path, metavar="FILE", help=".binary or _rgb.bsdf")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="LATENT.npy")
    parser.add_argument("--autoencoder", type=Path, metavar="DIR",
                        default=WEIGHTS / "material" / "material_autoencoder",
                        help="a folder material_autoencoder that tools.train.material wrote (default: the bundled one)")
    options = parser.parse_args()
    try:
        brdf = (AdaptiveBRDF if options.brdf.suffix == ".bsdf" else MeasuredBRDF).load(options.brdf)
        model = load_component(MaterialAutoencoder, options.autoencoder)
    except (CheckpointError, SceneError) as error:
        print(error, file=sys.stderr)
        return 1
    picture = sphere_picture(brdf, studio_panorama(), size=64)
    latent, decoded = encode(picture, model)
    np.save(options.output, latent)
    write_picture(options.output.with_suffix(".png"), np.concatenate([picture, decoded], axis=1))
    print(*(f"{value:.4f}" for value in latent))
    return 0


def write_picture(path: Path, linear: np.ndarray) -> None:
    from skimage.io import imsave

    write_atomically(path, lambda file: imsave(file, to_bytes(linear_to_srgb(linear)), check_contrast=False))


if __name__ == "__main__":
    from tools.extension import run

    run(main)
