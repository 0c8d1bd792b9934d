# SPDX-License-Identifier: GPL-3.0-or-later
"""Golden fixtures: read a case, make the weights of the recipe, build the network and its inputs."""
from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file

from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.inputs import (
    EnvironmentInputs,
    NetworkInputs,
    ViewInputs,
    VolumeInputs,
    encode_light,
)
from renderformer_v2.model.network.layers import rope_frequencies
from renderformer_v2.model.network.renderformer import RenderFormer

VOLUME_FIELDS = ("density", "position", "rotation", "scale", "scattering", "absorption")


@dataclass
class Case:
    """One fixture: its JSON and its tensors by name."""

    name: str
    info: dict
    tensors: dict[str, torch.Tensor]

    @classmethod
    def load(cls, path: Path) -> Case:
        return cls(path.stem, json.loads(path.read_text()), load_file(path.with_suffix(".safetensors")))

    @property
    def expected(self) -> dict[str, torch.Tensor]:
        """What was recorded: all tensors that are neither inputs nor helpers of the comparison."""
        return {k: v for k, v in self.tensors.items() if k.split(".")[0] not in ("in", "chk")}


def recipe_tensor(key: str, shape: tuple[int, ...], salt: int = 0) -> torch.Tensor:
    """The recipe's float32 weight for a state-dict key (tests/fixtures/README.md, Weights recipe)."""
    if key.endswith("rope_emb.freqs"):
        return rope_frequencies(2 * shape[0])
    seed = (zlib.crc32(key.encode()) + salt) % 2 ** 32
    x = np.random.Generator(np.random.PCG64(seed)).standard_normal(shape, dtype=np.float32)
    if len(shape) == 1:
        norm_like = key.endswith(".weight") or key.endswith("output_conv2.2.bias")
        return torch.from_numpy(np.float32(1 if norm_like else 0) + np.float32(0.02) * x)
    if len(shape) == 3:
        return torch.from_numpy(np.float32(0.5) * x)
    gain = 0.05 if key.endswith("output_conv2.2.weight") else 0.1 if key.endswith("decoder_final.6.weight") else 1.0
    if len(shape) != 4:
        gain = 1.0
    return torch.from_numpy(np.float32(gain / np.sqrt(np.prod(shape[1:]))) * x)


def with_recipe_weights(module: torch.nn.Module, salt: int = 0, prefix: str = "") -> torch.nn.Module:
    """Fill a module, which may live on the meta device, and switch it to evaluation."""
    state = {k: recipe_tensor(prefix + k, tuple(v.shape), salt) for k, v in module.state_dict().items()}
    module.load_state_dict(state, strict=True, assign=True)
    return module.requires_grad_(False).eval()


def recipe_network(config: ModelConfig, salt: int = 0) -> RenderFormer:
    with torch.device("meta"):
        network = new_network(config)
    return with_recipe_weights(network, salt)


def network_inputs(tensors: dict[str, torch.Tensor]) -> NetworkInputs:
    """The `in.*` tensors of a network case."""
    environment = volumes = None
    if "in.env_latent_ldr" in tensors:
        environment = EnvironmentInputs(*(tensors[f"in.env_{k}"] for k in ("latent_ldr", "latent_hdr", "strength")))
    if "in.volume_density" in tensors:
        real = tensors["in.volume_mask"].bool()
        volumes = VolumeInputs(**{f: tensors[f"in.volume_{f}"][real] for f in VOLUME_FIELDS})
    texture = tensors["in.texture"].float()
    return NetworkInputs(tensors["in.triangles"], tensors["in.vn"], texture, torch.arange(len(texture)),
                         encode_light(tensors["in.light_strength"]), environment, volumes)


def view_inputs(tensors: dict[str, torch.Tensor]) -> ViewInputs:
    """The cameras of a network case."""
    return ViewInputs(tensors["in.rays_o"], tensors["in.rays_d"])


class Recorder:
    """Collects what modules return, whole or chunk by chunk, while it is open."""

    def __init__(self, modules: dict[str, torch.nn.Module]):
        self.parts: dict[str, list[torch.Tensor]] = {name: [] for name in modules}
        self.inputs: dict[str, list[torch.Tensor]] = {name: [] for name in modules}
        self.handles = [module.register_forward_hook(self._hook(name)) for name, module in modules.items()]

    def _hook(self, name: str):
        def hook(module, args, output):
            self.inputs[name].append(args[0])
            self.parts[name].append(output.clone())  # the next layer may write its result there
        return hook

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *exc) -> None:
        for handle in self.handles:
            handle.remove()

    def __getitem__(self, name: str) -> torch.Tensor:
        return torch.cat(self.parts[name])


def relative_error(actual: torch.Tensor, expected: torch.Tensor) -> float:
    """max|a - b| / max|b|; integers are equal (0) or not (inf), and so are shapes."""
    if actual.shape != expected.shape:
        return float("inf")
    if not expected.is_floating_point():
        return 0.0 if torch.equal(actual.long(), expected.long()) else float("inf")
    difference = (actual.double() - expected.double()).abs().max().item()
    largest = expected.double().abs().max().item()
    error = difference / largest if largest > 0 else difference
    return error if error == error else float("inf")
