# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the network with golden fixtures: `python -m tools.parity FIXTURE_DIR [--precision bf16]`.

Prints one line per fixture tensor, "case name error", where error = max|a - b| / max|b|; exits with 1 when an error
exceeds 1e-4 or integers differ. With --precision, the networks of the full size run in that format and in float32
instead, "case PSNR" of the log images is printed, and below 50 dB the exit status is 1. A case that cannot be run, such
as one without its .safetensors, has failed: its line names the reason, and the others follow.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Iterator

import torch

from model.precision import PRECISIONS

from .fixture_cases import Case, relative_error
from .fixture_results import RESULTS, precision_psnr
from .self_check import self_check, weights_check

TOLERANCE = 1e-4
PSNR = 50.0  # dB
CHECKS = {"selfcheck": self_check, "weights_check": weights_check}  # JSON without tensors


def case_errors(case: Case) -> Iterator[tuple[str, float]]:
    """(tensor name, error) of everything that the case recorded."""
    results = RESULTS[case.info["kind"]](case)
    for name, expected in sorted(case.tensors.items()):
        base, _, cut = name.rpartition(".") if name.endswith((".rows", ".proj")) else (name, "", "")
        if name.startswith(("out.", "dbg.", "alt.")) or base in results:
            layouts = recorded_layouts(results[base], case, base, cut) if base in results else []
            yield name, min((relative_error(actual, expected) for actual in layouts), default=float("inf"))


def recorded_layouts(actual: torch.Tensor, case: Case, name: str, cut: str) -> list[torch.Tensor]:
    """Large tensors are recorded as some rows, or as all rows times a fixed matrix.

    Rows of several views lie in the file ray by ray, (rows, V, D), under the shape (V, rows, D); both are read.
    """
    if cut == "proj":
        return [(actual.double() @ case.tensors["chk.P"].double()).float()]
    if cut == "rows":
        rows = actual[..., case.tensors["chk.ray_rows" if "ray_" in name else "chk.token_rows"], :]
        return [rows, rows.transpose(0, 1).reshape(rows.shape)] if rows.dim() == 3 else [rows]
    return [actual]


def folder_errors(folder: Path) -> Iterator[tuple[str, str, float]]:
    """(case, tensor name, error) of every fixture in the folder; (case, reason, infinity) where one cannot be run."""
    for path in sorted({found.with_suffix(".json") for found in folder.glob("*")
                        if found.suffix in (".json", ".safetensors")}):
        try:
            for name, error in file_errors(path):
                yield path.stem, name, error
        except Exception as error:  # whatever it is, the other cases are compared too
            yield path.stem, reason(error), float("inf")


def file_errors(path: Path) -> Iterator[tuple[str, float]]:
    if path.stem in CHECKS:
        return CHECKS[path.stem](json.loads(path.read_text()))
    return case_errors(Case.load(path))


def reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())  # one line


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of fixtures (JSON + safetensors)")
    parser.add_argument("--precision", choices=[name for name in PRECISIONS if name != "fp32"],
                        help="compare this format with float32 instead of float32 with the fixtures")
    arguments = parser.parse_args()
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
    found = []
    for path in sorted(arguments.folder.glob("net_full*.json")):
        try:
            found.append(precision_psnr(Case.load(path), PRECISIONS[arguments.precision]))
            print(f"{path.stem} {found[-1]:.1f} dB{'' if found[-1] >= PSNR else '  FAILED'}", flush=True)
        except Exception as error:
            found.append(0.0)
            print(f"{path.stem} {reason(error)}  FAILED", flush=True)
    if not found:
        print(f"no fixtures of the full network in {arguments.folder}", file=sys.stderr)
    return 0 if found and all(psnr >= PSNR for psnr in found) else 1


if __name__ == "__main__":
    sys.exit(main())
