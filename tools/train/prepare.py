# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.prepare --data DIR: estimate the light of all samples before tools.train.network needs it.

Training does so too, at first use, but then it waits. A folder that still grows is looked through again every minute
until --minutes are over.
"""
from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import torch

from tools.common.console import whole_number
from tools.datagen.sample_files import sample_paths

from .config import Stage
from .errors import SampleError
from .loader import light_inputs_of
from .samples import LightInputs, prepare_sample

POLL_SECONDS = 60.0  # seconds


def prepare(path: Path, cache: Path, rays: float) -> None:
    """All that a stage with this share of `rays` reads of a sample; one that cannot be read is reported."""
    torch.set_num_threads(1)
    try:
        for light_inputs in (LightInputs.SCENE, light_inputs_of(path, rays)):
            prepare_sample(path, cache, light_inputs)
    except SampleError as error:
        print(f"{error} (left out)", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.prepare", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples, may still be growing")
    parser.add_argument("--cache", type=Path, help="prepared samples (default: DATA/../cache)")
    parser.add_argument("--minutes", type=float, default=0.0, help="to wait for more samples")
    parser.add_argument("--processes", type=whole_number(0), default=0, help="0 = one per core")
    options = parser.parse_args()
    cache, done, end = options.cache or options.data.parent / "cache", set(), time.monotonic() + 60 * options.minutes
    with ProcessPoolExecutor(options.processes or os.cpu_count()) as pool:
        while True:
            paths = [path for path in sample_paths(options.data) if path not in done]
            list(pool.map(prepare, paths, [cache] * len(paths), [Stage.rays] * len(paths)))
            done |= set(paths)
            print(f"{len(done)} samples are prepared", flush=True)
            if time.monotonic() + POLL_SECONDS > end:
                return 0
            time.sleep(POLL_SECONDS)


if __name__ == "__main__":
    sys.exit(main())
