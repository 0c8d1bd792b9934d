# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.verify_path [--work DIR]: the paper's architecture, trained in miniature on one room, renders it.

Makes samples of the example room (tools/datagen/scenes/example_room.py), trains a bundle in the published format on
them, renders rooms that it has not seen, and prints how near these pictures are to Cycles'. All steps are commands of
their own, which are printed; run again, it goes on where it was. It begins with the bundle of tests/fixtures, or with
nothing (--anew). This verifies a path: the paper's quality takes the paper's data and time.
"""
from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from renderformer_v2.model.published.bundle_files import find_missing_parts
from tools.common.console import whole_number
from tools.extension import ROOT

HELD_OUT = 900_001  # the first seed
CONFIG = Path(__file__).with_name("config.json")
COOLDOWN = 0.2      # of the minutes


class Failed(Exception):
    """A command that has said why."""


def main() -> int:
    options = parse_arguments()
    try:
        make_samples(options)
        train(options, choose_start(options))
    except Failed as failed:
        return failed.args[0]
    from .bundle import pack
    from .measure import measure
    trained = options.work / "run" / "bundle"
    mean = measure(options.work / "heldout", trained, options.work / "report")
    print(f"held-out rooms: {mean['psnr']:.1f} dB (the worst {mean['worst_psnr']:.1f}), a grey picture "
          f"{mean['grey']['psnr']:.1f} dB; pictures: {options.work / 'report' / 'report.html'}")
    if options.pack:
        pack(trained, options.pack)
    return 0


def make_samples(options: argparse.Namespace) -> None:
    common = ["--views", 4, "--hints", 1, "--profile", "example", "--processes", 1, "--threads", options.threads]
    for folder, scenes, first, samples in (("heldout", options.held_out, HELD_OUT, 64),
                                           ("train", options.scenes, 1, 16)):
        run("tools.datagen", options.work / folder, "--scenes", scenes, "--first-seed", first, "--samples", samples,
            *common)


def choose_start(options: argparse.Namespace) -> Path:
    """The bundle that training begins with."""
    from .bundle import COMMITTED
    new = options.work / "start"
    if not options.anew and not new.exists():
        return COMMITTED
    make_bundle(new, options)
    return new


def make_bundle(bundle: Path, options: argparse.Namespace) -> None:
    """Mappers and VAE trained on our spheres and tiles, and a transformer with new weights."""
    from .bundle import MATERIAL, begin
    if (bundle / "vae").is_dir() and not find_missing_parts(bundle):
        return
    begin(bundle)
    spheres, work = options.work / "spheres", options.work / "parts"
    mappers = ["diffspec_mapper", "metallic_mapper"]
    run("tools.datagen.spheres", spheres, "--mappers", *mappers, "--spheres", 600, "--samples", 8)
    run("tools.train.material", spheres, "--work", work, "-o", bundle, "--autoencoder", MATERIAL)
    run("tools.train.vae", options.work / "train", "--bundle", bundle, "--work", work)


def train(options: argparse.Namespace, start: Path) -> None:
    run("tools.train.published", "--data", options.work / "train", "--start", start, "--out", options.work / "run",
        "--config", CONFIG, "--minutes", options.minutes, "--cooldown", COOLDOWN * options.minutes, "--threads",
        options.threads, "--precision", "fp32")


def run(*command: object) -> None:
    """`python -m` with these words, in the repository's root. Raises Failed with its exit status."""
    words = list(map(str, command))
    print("python -m", *words, flush=True)
    if status := subprocess.run([sys.executable, "-m", *words], cwd=ROOT).returncode:
        raise Failed(status)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.verify_path", description=__doc__)
    parser.add_argument("--work", type=Path, default=ROOT / "data" / "path", help="folder of samples and training")
    parser.add_argument("--scenes", type=whole_number(1), default=500, help="to train on, four views each")
    parser.add_argument("--held-out", type=whole_number(1), default=8, help="scenes to measure with (default 8)")
    parser.add_argument("--minutes", type=float, default=240.0, help="of training (default 240)")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--anew", action="store_true", help="train mappers, VAE and transformer from new weights")
    parser.add_argument("--pack", type=Path, metavar="DIR", help="write the trained bundle there, in half precision")
    options = parser.parse_args()
    options.work = options.work.resolve()
    return options


if __name__ == "__main__":
    sys.exit(main())
