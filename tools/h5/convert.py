# SPDX-License-Identifier: GPL-3.0-or-later
"""Encode the textures of raw H5 scenes of the authors' code, and of those of its first version, with the published VAE.

    python -m tools.h5.convert RAW.h5 -o PROCESSED.h5 --weights DIR
    python -m tools.h5.convert FOLDER|LIST.txt -o DIR --weights DIR

The results are processed scenes as the authors' code makes them: rotation and strength of environments applied, volumes
of shape (M, 64). Files that are processed already are copied. Prints a line of JSON for each.
"""
from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

from renderformer_v2.model.compute.devices import choose_device
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.published.h5 import read_h5, write_h5
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tools.common.console import device_name, to_one_line
from tools.common.pictures import check_output

from .inputs import SUFFIXES, list_inputs


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.h5.convert", description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, help="raw .h5 scene, a folder of them, or a list of paths")
    parser.add_argument("-o", "--output", type=Path, required=True, help="of a single scene a file, else a folder")
    parser.add_argument("--weights", required=True, metavar="DIR", help="the published bundle")
    parser.add_argument("--device", type=device_name, default="auto", help="auto, cpu, cuda, cuda:1 or mps")
    options = parser.parse_args()
    try:
        for line in convert(options):
            print(json.dumps(line), flush=True)
    except (SceneError, CheckpointError, ValueError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    return 0


def convert(options: argparse.Namespace):
    """Write one scene after the other and yield a line for each."""
    inputs, is_single = list_inputs(options.scenes), options.output.suffix.lower() in SUFFIXES
    if is_single and len(inputs) > 1:
        raise ValueError(f"{options.scenes} holds {len(inputs)} scenes: choose a folder for -o")
    encoder = PublishedPipeline(options.weights, choose_device(options.device), None).encoder
    for path, _ in inputs:
        target = options.output if is_single else options.output / path.name
        check_output(target)
        if target.exists() and target.samefile(path):
            raise ValueError(f"{path} would be overwritten: choose another -o")
        scene = read_h5(path)
        with inference():
            encoded = encoder.encoded(scene)
        write_h5(target, replace(encoded, metadata={"scene_name": path.stem} | scene.metadata | {
            "postprocessed": True, "texture_encoder": "qwen_vae", "format": "v2"}))
        yield {"scene": str(path), "triangles": len(scene.triangles), "views": len(scene.fov),
               "volume_cells": 0 if scene.volumes is None else len(scene.volumes), "output": str(target)}


if __name__ == "__main__":
    sys.exit(main())
