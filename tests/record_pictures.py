# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tests.record_pictures: record the pictures of tests/pictures.py anew, for this Blender and processor."""
from __future__ import annotations

import json

import numpy as np

import tools  # noqa: F401  makes the package `renderformer_v2` importable
from tests.pictures import COPIES, HASHES, SCENES, Computed, compute, copy, copy_key, kind, read_copies, read_hashes
from tools.extension import run


def main() -> int:
    hashes, copies = read_hashes(), read_copies()
    for name in SCENES:
        record(hashes, copies, name, compute(name), kind())
    HASHES.write_text(json.dumps(hashes, indent=1) + "\n")
    np.savez_compressed(COPIES, **copies)
    return 0


def record(hashes: dict, copies: dict[str, np.ndarray], name: str, computed: Computed, kind: tuple[str, str]) -> None:
    """What was computed of a scene; hashes of other processors are dropped if this one's were others before."""
    version, processor = kind
    recorded = hashes.setdefault(name, {}).setdefault(version, {})
    if recorded.get(processor) == computed.hashes:
        return
    if processor in recorded:
        recorded.clear()
    if not recorded:
        for light, picture in computed.pictures.items():
            copies.pop(f"{name}, {light}", None)  # one of all versions
            copies[copy_key(name, light, version)] = copy(picture)
    recorded[processor] = computed.hashes


if __name__ == "__main__":
    run(main)
