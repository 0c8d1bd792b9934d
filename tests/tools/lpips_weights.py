# SPDX-License-Identifier: GPL-3.0-or-later
"""Made up weights of LPIPS, in files as torchvision and its authors write them."""
from pathlib import Path

import torch

from tools.common.lpips import BACKBONES, Lpips


def write_weights(folder: Path, backbone: str) -> Lpips:
    """The network with these weights."""
    torch.manual_seed(0)
    network = Lpips(backbone).eval().requires_grad_(False)
    for p in network.weights:
        p.uniform_(0, 1)
    features = {name: tensor for name, tensor in network.state_dict().items() if name.startswith("features.")}
    torch.save(features | {"classifier.1.weight": torch.ones(2, 2)}, folder / BACKBONES[backbone].file)
    torch.save({f"lin{i}.model.1.weight": p.data for i, p in enumerate(network.weights)}, folder / f"{backbone}.pth")
    return network
