# SPDX-License-Identifier: GPL-3.0-or-later
"""Which operators PyTorch has for Apple's GPUs, by the table that it is built from and that comes with it."""
from functools import cache
from pathlib import Path

import torchgen
import yaml

EVERYWHERE = ("MPS", "CompositeExplicitAutograd", "CompositeExplicitAutogradNonFunctional", "CompositeImplicitAutograd")


def is_composite(name: str) -> bool:
    """Whether other operators are called in its place on every device."""
    row = _row(name)
    return row is not None and row["of"] is None and "MPS" not in row["kernels"] and (
        not row["kernels"] or "CompositeImplicitAutograd" in row["kernels"])


def is_supported(name: str) -> bool:
    """Whether PyTorch has an operator such as "aten::add.Tensor" for MPS."""
    row = _row(name)
    if row is None:
        return True
    if row["of"] is not None and not row["kernels"] & set(EVERYWHERE):
        return is_supported(row["of"])
    return not row["kernels"] or bool(row["kernels"] & set(EVERYWHERE))


def _row(name: str) -> dict | None:
    return _table().get(name.removeprefix("aten::").removesuffix(".vec"))


@cache
def _table() -> dict[str, dict]:
    """Of every operator the kinds of its kernels, and the operator whose kernels it uses."""
    file = Path(torchgen.__file__).parent / "packaged" / "ATen" / "native" / "native_functions.yaml"
    rows = yaml.load(file.read_text(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return {row["func"].split("(")[0]: {"of": row.get("structured_delegate"), "kernels": {
        kind.strip() for kinds in row.get("dispatch", {}) for kind in kinds.split(",")}} for row in rows}
