# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS (Zhang et al. 2018) by the weights of its authors and of torchvision, without their packages.

Two files for each backbone, in one folder: torchvision's of the backbone, and the weights of LPIPS, which its package
holds as weights/v0.1/vgg.pth and alex.pth.
"""
from __future__ import annotations

import importlib.util
import pickle
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from renderformer_v2.model.errors import CheckpointError

SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)  # of pictures from -1 to 1
TINY = 1e-10


@dataclass(frozen=True)
class Backbone:
    file: str                            # of torchvision
    layers: tuple[tuple[int, ...], ...]  # convolutions: outputs, size, stride, padding; pools: size, stride
    taps: tuple[int, ...]                # convolutions whose result is compared


def _vgg() -> Backbone:
    pool, layers = (2, 2), []
    for width, count in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        layers += [pool] * bool(layers) + [(width, 3, 1, 1)] * count
    return Backbone("vgg16-397923af.pth", tuple(layers), (1, 3, 6, 9, 12))


BACKBONES = {
    "vgg": _vgg(),
    "alex": Backbone("alexnet-owt-7be5be79.pth", ((64, 11, 4, 2), (3, 2), (192, 5, 1, 2), (3, 2), (384, 3, 1, 1),
                                                  (256, 3, 1, 1), (256, 3, 1, 1)), (0, 1, 2, 3, 4))}


class Lpips(nn.Module):
    """Distance of pictures (V, 3, H, W) in [0, 1] -> (V,); names of the weights are those of the two files."""

    def __init__(self, backbone: str = "vgg"):
        super().__init__()
        described = BACKBONES[backbone]
        self.features, width, widths, self.taps = nn.Sequential(), 3, [], set()
        for layer in described.layers:
            if len(layer) == 2:
                self.features.append(nn.MaxPool2d(*layer))
                continue
            self.features.append(nn.Conv2d(width, *layer))
            self.features.append(nn.ReLU())
            width = layer[0]
            if sum(isinstance(module, nn.ReLU) for module in self.features) - 1 in described.taps:
                self.taps.add(len(self.features) - 1)
                widths.append(width)
        self.weights = nn.ParameterList(nn.Parameter(torch.ones(1, width, 1, 1)) for width in widths)
        for name, value in (("shift", SHIFT), ("scale", SCALE)):
            self.register_buffer(name, torch.tensor(value).view(1, 3, 1, 1), persistent=False)

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        return sum((weight * (x - y).square()).sum(1).mean((1, 2))
                   for weight, x, y in zip(self.weights, self._unit_features(a), self._unit_features(b), strict=True))

    def _unit_features(self, x: Tensor) -> Iterable[Tensor]:
        x = (2 * x - 1 - self.shift) / self.scale
        for i, module in enumerate(self.features):
            x = module(x)
            if i in self.taps:
                yield x / (x.square().sum(1, keepdim=True).sqrt() + TINY)


def default_folder() -> Path:
    """Where torchvision keeps what it has downloaded."""
    return Path(torch.hub.get_dir()) / "checkpoints"


def lpips_files(backbone: str, folder: Path | None = None) -> tuple[Path, Path] | None:
    """The backbone's file and LPIPS' own, which may be that of its package; None where one of them is missing."""
    folder = folder or default_folder()
    package = importlib.util.find_spec("lpips")
    places = [folder, *(Path(place) / "weights/v0.1" for place in package.submodule_search_locations or ())] \
        if package else [folder]
    own = next((file for place in places if (file := place / f"{backbone}.pth").is_file()), None)
    features = folder / BACKBONES[backbone].file
    return (features, own) if own and features.is_file() else None


def load_lpips(backbone: str = "vgg", folder: Path | None = None) -> Lpips | None:
    """The metric; None where its weights are not on this machine. Raises CheckpointError for files of something else.
    """
    files = lpips_files(backbone, folder)
    if files is None:
        return None
    network, (features, own) = Lpips(backbone), map(_read, files)
    state = {name: tensor for name, tensor in features.items() if name.startswith("features.")}
    state |= {f"weights.{i}": own.get(f"lin{i}.model.1.weight") for i in range(len(network.weights))}
    try:
        network.load_state_dict({name: tensor for name, tensor in state.items() if tensor is not None})
    except RuntimeError as error:
        raise CheckpointError(f"{files[0]} and {files[1]} are not the weights of LPIPS ({' '.join(str(error).split())})"
                              ) from error
    return network.eval().requires_grad_(False)


def _read(file: Path) -> dict[str, Tensor]:
    try:
        return torch.load(file, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
        raise CheckpointError(f"{file} cannot be read ({error}): download it again") from error
