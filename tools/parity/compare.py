# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of everything that the fixtures of a folder recorded."""
from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import torch

from .cases import Case, relative_error
from .results import RESULTS
from .self_check import self_check, weights_check

TOLERANCE = 1e-4
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
    for path in sorted({file.with_suffix(".json") for file in folder.glob("*")
                        if file.suffix in (".json", ".safetensors")}):
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
