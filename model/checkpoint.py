# SPDX-License-Identifier: GPL-3.0-or-later
"""Load and save weights: strict loading of safetensors, and this project's own format (config.json +
model.safetensors).

Every function that reads raises CheckpointError with the path and what to do. published/bundle.py reads the published
bundle.
"""
from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path

import torch
from torch import nn

from .errors import CheckpointError
from .guided.network import GuidedRenderFormer
from .material.mappers import Mapper, MetallicTransmissionMapper
from .network.config import ModelConfig
from .network.renderformer import RenderFormer
from .presets import WEIGHTS

MATERIAL_MAPPER = WEIGHTS / "material" / "metallic_transmission_mapper"
FORMAT = {"format": "renderformer-model", "format_version": 2}
FLOATS = ("F16", "BF16", "F32", "F64")  # safetensors' names
SOME = 8  # names in a message
PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl")


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


@contextmanager
def explained():
    """What the operating system refuses becomes a CheckpointError; around everything that looks into folders."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"{error.filename} cannot be read ({error.strerror}): check its permissions") from error


@explained()
def load_network(folder: Path, name: str = "config.json") -> RenderFormer:
    """The network of one folder in this project's format; `name` is the file that describes it."""
    if folder.is_dir() and not (folder / name).is_file():
        raise CheckpointError(f"{folder} holds no weights: choose the folder renderformer-v2 (with transformer_512 or "
                              "transformer_2048, and the mappers), or one that tools.train.network wrote (with "
                              f"{name}); it holds {listing(folder)}")
    description = read_json(require(folder, name))
    found = {key: description.get(key) for key in FORMAT}
    if "format" not in description:
        raise version_one(folder / name)
    if found != FORMAT:
        raise CheckpointError(f"{folder / name} is of an unknown format: expected {FORMAT}, found {found}")
    model_config = description.get("model_config", {})
    if not isinstance(model_config, dict):
        raise CheckpointError(f"{folder / name}: model_config is not a JSON object: download or copy it again")
    return build_network(ModelConfig.from_dict(model_config), weights_file(folder))


def build_network(config: ModelConfig, file: Path) -> RenderFormer:
    """The network of a configuration with the weights of a file."""
    with torch.device("meta"):
        network = new_network(config)
    return load_weights(network, file)


def new_network(config: ModelConfig) -> RenderFormer:
    """The network of a configuration, ready to be trained."""
    return GuidedRenderFormer(config) if config.guidance else RenderFormer(config)


def load_material_mapper(folder: Path = MATERIAL_MAPPER) -> Mapper:
    """The bundled mapper from Principled parameters to the 9-D latent."""
    return load_component(MetallicTransmissionMapper, folder)


def load_component(kind: type[nn.Module], folder: Path) -> nn.Module:
    """A mapper or autoencoder: constructor arguments in config.json, weights beside it (docs/scene-input.md 12)."""
    arguments = read_json(require(folder, "config.json"))
    try:
        with torch.device("meta"):
            module = kind(**arguments)
    except (TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"{folder / 'config.json'} does not fit {kind.__name__}: {error}") from error
    return load_weights(module, weights_file(folder))


@explained()
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


@explained()
def weights_file(folder: Path) -> Path:
    """The folder's model.safetensors; explains why pickled weights are refused."""
    file = folder / "model.safetensors"
    if not file.is_file() and folder.is_dir():
        pickles = sorted(p.name for p in folder.iterdir() if p.suffix in PICKLES)
        if pickles:
            raise CheckpointError(f"{folder / pickles[0]} is a pickle, which can run any program when it is opened: "
                                  "use the safetensors version of these weights")
    return require(folder, "model.safetensors")


def version_one(file: Path) -> CheckpointError:
    """For a config.json without our format, as the authors' first model has one."""
    return CheckpointError(f"{file} belongs to a RenderFormer-V1 checkpoint (such as microsoft/renderformer-v1-base or "
                           "renderformer-v1.1-swin-large), another network, which knows no environment and "
                           "no volumes and cannot be used: expected is the folder of RenderFormer/renderformer-v2")


@explained()
def listing(folder: Path) -> str:
    """The first names in a folder, for messages."""
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    return ", ".join(names[:SOME]) + (f" and {len(names) - SOME} more" if len(names) > SOME else "") or "nothing"


@explained()
def require_folder(folder: Path) -> None:
    """The weights folder must exist."""
    if folder.suffix in PICKLES:
        raise CheckpointError(f"{folder} is a pickle, which can run any program when opened: use safetensors weights")
    if folder.is_file():
        raise CheckpointError(f"{folder} is a file: choose the folder that it lies in")
    if not folder.is_dir():
        raise CheckpointError(f"there is no weights folder {folder}")


@explained()
def require(folder: Path, name: str) -> Path:
    """folder / name, which must exist."""
    require_folder(folder)
    file = folder / name
    if not file.is_file():
        raise CheckpointError(f"{file} is missing: the weights folder is incomplete (it holds {listing(folder)}), "
                              "download or copy it again")
    return file


@explained()
def read_json(file: Path) -> dict:
    """A JSON object."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CheckpointError(f"{file} cannot be read ({error}): download or copy it again") from error
    if not isinstance(content, dict):
        raise CheckpointError(f"{file} does not hold a JSON object: found {type(content).__name__}")
    return content
