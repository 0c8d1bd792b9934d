# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.datagen OUT_DIR --scenes N --first-seed S: random scenes with Cycles references.

One file per seed; seeds whose file is there are skipped, so a killed run goes on where it was. A seed always gives the
same scene. --profile simple has no textures, glass or volumes and at most four lights; mixed makes every third seed
(those that 3 divides) simple and the others full; scenes/layers.py (layered), scenes/wide.py, scenes/interiors.py
(indirect) and scenes/paper.py say what the other profiles hold; example is one room (scenes/example_room.py). A line of
each sample goes into a manifest (manifest.py). --hdris, --meshes and --textures name folders of your own files.

python -m tools.datagen OUT_DIR --blend FILE.blend [FILE.blend ...]: samples of your own scenes (blend_files.py). The
files are opened and never saved; a sample is made again when its file is newer.
"""
from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tools.common.console import silence_blender, whole_number

from . import manifest
from .sample_files import HINT_SAMPLES, SampleCounts, sample_path, save_sample
from .scenes.own_files import OWN_FILES

DARKEST, BRIGHTEST = 0.03, 1.5  # mean of a view's median over covered pixels
ATTEMPTS = 8


class Recipe(NamedTuple):
    """How random scenes are made."""

    profile: str
    views: int
    resolution: int | None  # pixels, both sides; None: the scene's own
    triangles: int | None   # of a scene at most; None likewise


def generate(out: Path, seeds: range, of_all: SampleCounts, recipe: Recipe, threads: int) -> int:
    """Make the samples that are missing in `out`; a seed that fails is reported. Returns how many failed.

    Raises OSError when `out` cannot be written.
    """
    from . import render_sample

    out.mkdir(parents=True, exist_ok=True)
    render_sample.prepare(threads)
    finished, failed, start = 0, 0, time.time()
    entries = out / f"manifest_{seeds.start:08d}.jsonl"
    for seed in seeds:
        path = sample_path(out, seed)
        if path.exists():
            continue
        counts = of_all.of_seed(seed)
        try:
            sample, attempt = make_sample(seed, counts, recipe)
        except Exception:  # one odd scene must not end a run of days
            print(f"seed {seed} failed:", traceback.format_exc(), sep="\n")
            failed += 1
            continue
        save_sample(path, sample.scene, sample.views, sample.guides, sample.passes, hints=counts.hints)
        manifest.append_entries(entries, [manifest.make_entry(path)])
        finished += 1
        times = " ".join(f"{stage} {seconds:.2f}" for stage, seconds in sample.seconds.items())
        print(f"{path.name}: {len(sample.scene)} triangles, attempt {attempt + 1}, {times} s; "
              f"{finished} scenes, {60 * finished / (time.time() - start):.1f} a minute", *sample.report.lines(),
              sep="\n  ")
    return failed


def make_sample(seed: int, counts: SampleCounts, recipe: Recipe):
    """The first well exposed `render_sample.Sample` of a seed, or the last, and the number of attempts before it."""
    from . import render_sample
    from .scenes import generator

    profile = recipe.profile
    if profile == "mixed":
        profile = "full" if seed % 3 else "simple"
    for attempt in range(ATTEMPTS):
        is_last = attempt == ATTEMPTS - 1
        setup = generator.build_scene((seed, attempt), profile, recipe.views, recipe.triangles)
        if recipe.resolution:
            setup = setup._replace(resolution=recipe.resolution)
        sample = render_sample.make_sample(
            setup, counts, lambda passes, is_last=is_last: is_last or is_well_exposed(passes["combined"]))
        if sample is not None:
            return sample, attempt


def is_well_exposed(combined: np.ndarray) -> bool:
    """Neither nearly black nor mostly burnt out, where it is covered."""
    covered = combined[combined[..., 3] > 0.5, :3]
    return len(covered) > 0 and DARKEST <= float(np.median(covered, axis=0).mean()) <= BRIGHTEST


def main() -> int:
    args = parse_arguments()
    counts = SampleCounts(args.samples, args.equal, args.hints, args.most_hints or args.hints)
    return sample_blend_files(args, counts) if args.blend else sample_random_scenes(args, counts)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.datagen", description=__doc__)
    parser.add_argument("out", type=Path, metavar="OUT_DIR")
    parser.add_argument("--blend", type=Path, nargs="+", metavar="FILE", help="your own scenes in place of random ones")
    parser.add_argument("--scenes", type=whole_number(1))
    parser.add_argument("--first-seed", type=whole_number(0))
    parser.add_argument("--views", type=whole_number(1), help="of a scene (default 2), or of a file (default 8)")
    parser.add_argument("--resolution", type=whole_number(1),
                        help="of all pictures (default 128; paper: 256; wide: 128 to 512 by chance)")
    parser.add_argument("--triangles", type=whole_number(256),
                        help="of a scene at most (default 3072; paper: 1024; wide: 2048 to 16384 by chance)")
    parser.add_argument("--samples", type=whole_number(1), default=32,
                        help="of the reference, before OpenImageDenoise")
    parser.add_argument("--equal", type=whole_number(0), default=0, metavar="N",
                        help="also store Cycles with N samples and OpenImageDenoise, for tools.evaluate")
    parser.add_argument("--hints", type=whole_number(1), default=HINT_SAMPLES, metavar="N",
                        help="samples of first hits and traced light (default 8)")
    parser.add_argument("--most-hints", type=whole_number(1), metavar="N",
                        help="instead from --hints to N, by chance: twice as many are half as likely")
    parser.add_argument("--profile", default="full",
                        choices=("simple", "full", "layered", "mixed", "wide", "indirect", "paper", "example"))
    for option, what in (("--hdris", "panoramas"), ("--meshes", "objects"), ("--textures", "sets of texture maps")):
        parser.add_argument(option, type=Path, metavar="DIR", help=f"your own {what}, beside those that are built in")
    parser.add_argument("--own", type=float, default=0.5, metavar="SHARE",
                        help="of what is chosen, how much is yours: 0 to 1 (default 0.5)")
    parser.add_argument("--open-meshes", action="store_true", help="use objects that are not watertight as well")
    parser.add_argument("--processes", type=whole_number(0), default=0,
                        help="each takes every n-th seed; 0 = one per core")
    parser.add_argument("--threads", type=whole_number(0), default=0,
                        help="of each process; 0 = an equal share of the cores")
    parser.add_argument("--part", type=int, default=0, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if not args.blend and (args.scenes is None or args.first_seed is None):
        parser.error("either --blend, or --scenes and --first-seed are needed")
    return args


def sample_random_scenes(args: argparse.Namespace, counts: SampleCounts) -> int:
    """Samples of random scenes, by several processes. Returns the exit status."""
    try:
        OWN_FILES.use_folders(args.hdris, args.meshes, args.textures, args.own, args.open_meshes)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    # One thread each leaves no core idle while a process converts, looks for hits or writes.
    processes = min(args.processes or os.cpu_count() or 1, args.scenes)
    if processes > 1 and not args.part:
        return share_out(processes, args.threads or -(-(os.cpu_count() or 1) // processes))
    silence_blender()
    first = args.first_seed + max(args.part - 1, 0)
    recipe = Recipe(args.profile, args.views or 2, args.resolution, args.triangles)
    seeds = range(first, args.first_seed + args.scenes, processes)
    try:
        failed = generate(args.out, seeds, counts, recipe, args.threads)
    except OSError as error:
        return report_unwritable(args.out, error)
    return 1 if failed else 0


def sample_blend_files(args: argparse.Namespace, counts: SampleCounts) -> int:
    """Samples of the user's files, by one process: Cycles keeps all cores busy. Returns the exit status."""
    silence_blender()
    from . import blend_files
    try:
        failed = blend_files.generate(args.out, args.blend, counts, views=args.views or 8, threads=args.threads,
                                      resolution=args.resolution or 128)
    except OSError as error:
        return report_unwritable(args.out, error)
    return 1 if failed else 0


def report_unwritable(out: Path, error: OSError) -> int:
    print(f"{out} cannot be written: {error.strerror or error}", file=sys.stderr)
    return 1


def share_out(processes: int, threads: int) -> int:
    """Run this command line as several processes, each with its part of the seeds; 1 if any of them fails."""
    command = [sys.executable, "-m", "tools.datagen", *sys.argv[1:], "--processes", str(processes)]
    running = [subprocess.Popen([*command, "--threads", str(threads), "--part", str(i + 1)]) for i in range(processes)]
    return int(any([process.wait() for process in running]))


if __name__ == "__main__":
    from tools.extension import run

    run(main)
