# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the network with golden fixtures: `python -m tools.parity FIXTURE_DIR [--precision bf16 [--exact-view]]`.

Prints one line per fixture tensor, "case name error", where error = max|a - b| / max|b|; exits with 1 when an error
exceeds 1e-4 or integers differ. With --precision, the networks of the full size run in that format and in float32
instead, "case PSNR" of the log images is printed, and below 50 dB the exit status is 1; with --exact-view stage 2 is
stored as on a card with TensorFloat-32. A case that cannot be run, such as one without its .safetensors, has failed:
its line names the reason, and the others follow.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

from renderformer_v2.model.compute.precision import PRECISIONS

from .cases import Case
from .compare import TOLERANCE, folder_errors, reason
from .results import precision_psnr

PSNR = 50.0  # dB


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of fixtures (JSON + safetensors)")
    parser.add_argument("--precision", choices=[name for name in PRECISIONS if name != "fp32"],
                        help="compare this format with float32 instead of float32 with the fixtures")
    parser.add_argument("--exact-view", action="store_true",
                        help="with --precision: stage 2 stays in float32, but for its cross-attention")
    arguments = parser.parse_args()
    if arguments.exact_view and not arguments.precision:
        parser.error("--exact-view needs --precision")
    return compare_precision(arguments) if arguments.precision else compare_fixtures(arguments.folder)


def compare_fixtures(folder: Path) -> int:
    count, worst = 0, 0.0
    for case, name, error in folder_errors(folder):
        count, worst = count + 1, max(worst, error)
        print(f"{case} {name} {error:.3e}{'' if error <= TOLERANCE else '  FAILED'}", flush=True)
    if not count:
        print(f"no fixtures in {folder}", file=sys.stderr)
        return 1
    print(f"{count} tensors, largest error {worst:.3e}")
    return 0 if worst <= TOLERANCE else 1


def compare_precision(arguments: argparse.Namespace) -> int:
    results = []
    for path in sorted(arguments.folder.glob("net_full*.json")):
        try:
            results.append(precision_psnr(Case.load(path), PRECISIONS[arguments.precision], arguments.exact_view))
            print(f"{path.stem} {results[-1]:.1f} dB{'' if results[-1] >= PSNR else '  FAILED'}", flush=True)
        except Exception as error:
            results.append(0.0)
            print(f"{path.stem} {reason(error)}  FAILED", flush=True)
    if not results:
        print(f"no fixtures of the full network in {arguments.folder}", file=sys.stderr)
    return 0 if results and all(psnr >= PSNR for psnr in results) else 1


if __name__ == "__main__":
    sys.exit(main())
