# SPDX-License-Identifier: GPL-3.0-or-later
"""What `test_train_ranks.py` has two processes do: `torchrun ... -m tests.tools.rank_program FOLDER`."""
import argparse
import json
import sys
from pathlib import Path

import torch
from torch import nn

import tools  # noqa: F401  makes the package `renderformer_v2` importable
from tools.train import material, ranks
from tools.train.errors import TrainingError


def spheres(work: Path) -> list[float]:
    """Weights of a small part after 20 steps of `material.fit`, twice."""
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(3, 4), nn.ReLU(), nn.Linear(4, 2))
    x = torch.linspace(0, 1, 90).view(30, 3)
    work.mkdir(exist_ok=True)
    for name, wanted in (("part", 1.0), ("same-part-again", 0.5)):  # as mapper and decoder, then encoder and decoder
        material.fit(model, lambda indices, wanted=wanted: (model(x[indices]) - wanted).square().mean(), len(x),
                     work / f"{name}.safetensors", steps=20, batch=8, rate=0.1)
    return torch.cat([p.detach().flatten() for p in model.parameters()]).tolist()


def shared_out() -> str:
    try:
        return str(ranks.share(3, "--scenes-per-step"))
    except TrainingError as error:
        return str(error)


def threads() -> list[str]:
    """Names of this process's threads, Python's and others (Linux only)."""
    return [(task / "comm").read_text().strip() for task in Path("/proc/self/task").glob("*")]


def main() -> None:
    folder, options = Path(sys.argv[1]), argparse.Namespace(device="cpu")
    torch.set_num_threads(1)
    with ranks.join(options):
        found = {"spheres": spheres(folder / f"work-{ranks.count()}"),
                 "share": shared_out(), "agreed": ranks.broadcast(float(ranks.rank() + 5)),
                 "means": ranks.compute_means({"a": torch.tensor(float(ranks.rank()))})["a"],
                 "gathered": sorted(ranks.gather({ranks.rank(): None}))}
        (folder / f"{ranks.rank()}-of-{ranks.count()}.json").write_text(json.dumps(found))
    assert not [name for name in threads() if "gloo" in name]  # which would still run while the interpreter ends


if __name__ == "__main__":
    main()
