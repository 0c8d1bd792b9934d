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

from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.material.measured import grey_light
from renderformer_v2.model.material.measured_latent import AUTOENCODER, encode_brdf
from renderformer_v2.model.pictures import linear_to_srgb
from tools.common.pictures import to_bytes, write_atomically


def studio_light() -> np.ndarray:
    """(64, 128) f32, the light of tools.datagen.spheres, row 0 looking up."""
    from renderformer_v2.rf2_engine.picture_files import read_pixels, studio_light_file
    return grey_light(read_pixels(studio_light_file("studio")))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.measured", description=__doc__)
    parser.add_argument("brdf", type=Path, metavar="FILE", help=".binary or _rgb.bsdf")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="LATENT.npy")
    parser.add_argument("--autoencoder", type=Path, metavar="DIR", default=AUTOENCODER,
                        help="a folder material_autoencoder that tools.train.material wrote (default: the bundled one)")
    options = parser.parse_args()
    try:
        latent, picture, decoded = encode_brdf(options.brdf, studio_light(), options.autoencoder)
    except (CheckpointError, SceneError) as error:
        print(error, file=sys.stderr)
        return 1
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
