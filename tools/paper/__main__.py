# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's tables and figures, made here and set beside the paper's numbers where it has any.

    python -m tools.paper runtime -o DIR ...            # both plots of seconds, by tools.benchmark
    python -m tools.paper lpips-triangles -o DIR ...    # error by triangles: ours, and with full attention
    python -m tools.paper ablation --data DIR --held-out DIR --out DIR ...    # tools.ablation
    python -m tools.paper latents -o DIR ...            # the space of material latents, as a picture
    python -m tools.paper measured PICTURES... -o DIR   # measured materials through the autoencoder
    python -m tools.paper scenes FRAMES... -o DIR ...   # the authors' scenes: ours and Cycles

--help after a name lists its options. Every command writes a table (.md) and its numbers (.json), some a picture, into
DIR, and goes on where it was stopped. LPIPS needs its weights (docs/authors-code.md 4); structure takes its place.
"""
from __future__ import annotations

import importlib
import sys

from renderformer_v2.model.errors import CheckpointError, SceneError
from tools import ablation, extension
from tools.common.console import to_one_line

TABLES = {"runtime": "runtime", "lpips-triangles": "triangles", "latents": "latents", "measured": "measured",
          "scenes": "scenes"}


def main() -> int:
    name, *arguments = sys.argv[1:] or ["--help"]
    if name == "ablation":
        return ablation.main(arguments)
    if name not in TABLES:
        print(__doc__, file=sys.stdout if name in ("-h", "--help") else sys.stderr)
        return 0 if name in ("-h", "--help") else 2
    try:
        importlib.import_module(f"tools.paper.{TABLES[name]}").main(arguments)
    except (CheckpointError, SceneError, RuntimeError, ValueError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    extension.run(main)
