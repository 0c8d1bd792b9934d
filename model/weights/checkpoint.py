# SPDX-License-Identifier: GPL-3.0-or-later
"""Load and save weights: strict loading of safetensors, and this project's own format (config.json +
model.safetensors).

Every function that reads raises CheckpointError with the path and what to do. Which networks there are is none of
this module's business: `kind` makes one of a configuration. published/bundle.py reads the published bundle; files.py
looks into folders without PyTorch.
"""
from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from torch import nn

from ..errors import CheckpointError
from ..network.config import ModelConfig
from .files import FORMAT, checkpoint_errors, described, read_json, require, weights_file

Network = TypeVar("Network", bound=nn.Module)
FLOATS = ("F16", "BF16", "F32", "F64")  # safetensors' names


def save_network(folder: str | Path, config: ModelConfig, state: dict[str, torch.Tensor]) -> None:
    """Write config.json and model.safetensors in half precision; the RoPE frequencies stay exact."""
    from safetensors.torch import save_file

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    dtypes = {key: torch.float32 if key.endswith("rope_emb.freqs") else torch.float16 for key in state}
    state = {key: value.detach().to("cpu", dtypes[key]).contiguous() for key, value in state.items()}
    # The old file may be memory-mapped by a running engine, so it is replaced and never rewritten.
    partial = folder / "model.safetensors.part"
    save_file(state, partial)
    partial.replace(folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps(FORMAT | {"model_config": config.to_dict()}, indent=1) + "\n")


@checkpoint_errors()
def read_network(kind: Callable[[ModelConfig], Network], folder: Path, name: str = "config.json") -> Network:
    """The network of one folder in this project's format; `name` is the file that describes it."""
    return build_network(kind, ModelConfig.from_dict(described(folder, name)), weights_file(folder))


def build_network(kind: Callable[[ModelConfig], Network], config: ModelConfig, file: Path) -> Network:
    """The network of a configuration with the weights of a file."""
    with torch.device("meta"):
        network = kind(config)
    return load_weights(network, file)


def load_component(kind: type[nn.Module], folder: Path) -> nn.Module:
    """A mapper or autoencoder: constructor arguments in config.json, weights beside it (docs/scene-input.md 12)."""
    arguments = read_json(require(folder, "config.json"))
    try:
        with torch.device("meta"):
            module = kind(**arguments)
    except (TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"{folder / 'config.json'} does not fit {kind.__name__}: {error}") from error
    return load_weights(module, weights_file(folder))


@checkpoint_errors()
def load_weights(module: nn.Module, file: Path) -> nn.Module:
    """Give a module on the meta device the tensors of a safetensors file, strictly, and switch it to evaluation.

    Float32 tensors stay memory-mapped; half precision is widened.
    """
    from safetensors import SafetensorError, safe_open

    file.open("rb").close()  # safetensors would call a file that may not be read a missing one
    wanted = {key: tuple(value.shape) for key, value in module.state_dict().items()}
    try:
        with safe_open(file, framework="pt") as stored:
            slices = {key: stored.get_slice(key) for key in stored.keys()}
            _compare(wanted, {key: tuple(part.get_shape()) for key, part in slices.items()}, file)
            for key, part in slices.items():
                if part.get_dtype() not in FLOATS:
                    raise CheckpointError(f"{file}: {key} is stored as {part.get_dtype()}, not as one of {FLOATS}")
            state = {key: stored.get_tensor(key).float() for key in wanted}
    except SafetensorError as error:
        raise CheckpointError(f"{file} is damaged or incomplete ({error}): download or copy it again") from error
    module.load_state_dict(state, strict=True, assign=True)
    return module.requires_grad_(False).eval()


def _compare(wanted: dict[str, tuple], found: dict[str, tuple], file: Path) -> None:
    missing, unexpected = sorted(set(wanted) - set(found)), sorted(set(found) - set(wanted))
    if missing or unexpected:
        parts = [f"{len(keys)} {kind} (first: {keys[0]})"
                 for kind, keys in (("missing", missing), ("unexpected", unexpected)) if keys]
        raise CheckpointError(f"{file} does not hold the weights of this configuration: {', '.join(parts)}")
    for key, shape in wanted.items():
        if found[key] != shape:
            raise CheckpointError(f"{file}: {key} has shape {found[key]}, the configuration asks for {shape}")
