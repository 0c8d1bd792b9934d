# SPDX-License-Identifier: GPL-3.0-or-later
"""Look into a folder of weights without PyTorch.

Every function but the last two raises CheckpointError with the path and what to do.
"""
from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path

from ..errors import CheckpointError

FORMAT = {"format": "renderformer-model", "format_version": 2}
SOME = 8  # names in a message
LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # how the text begins that Git LFS has in place of a file
PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl")


@contextmanager
def checkpoint_errors():
    """What the operating system refuses becomes a CheckpointError; around everything that looks into folders."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"{error.filename} cannot be read ({error.strerror}): check its permissions") from error


def described(folder: Path, name: str = "config.json") -> dict:
    """What the file `name` says of a network in this project's format: the arguments of its ModelConfig."""
    if folder.is_dir() and not (folder / name).is_file():
        raise CheckpointError(f"{folder} holds no weights: choose the folder renderformer-v2 (with transformer_512 or "
                              "transformer_2048, and the mappers), or that of a network you trained (with "
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
    return model_config


@checkpoint_errors()
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


@checkpoint_errors()
def listing(folder: Path) -> str:
    """The first names in a folder, for messages."""
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    return ", ".join(names[:SOME]) + (f" and {len(names) - SOME} more" if len(names) > SOME else "") or "nothing"


@checkpoint_errors()
def require_folder(folder: Path) -> None:
    """The weights folder must exist."""
    if folder.suffix in PICKLES:
        raise CheckpointError(f"{folder} is a pickle, which can run any program when opened: use safetensors weights")
    if folder.is_file():
        raise CheckpointError(f"{folder} is a file: choose the folder that it lies in")
    if not folder.is_dir():
        raise CheckpointError(f"There is no weights folder {folder}: choose the one that the weights lie in")


@checkpoint_errors()
def require(folder: Path, name: str) -> Path:
    """folder / name, which must exist."""
    require_folder(folder)
    file = folder / name
    if not file.is_file():
        raise CheckpointError(f"{file} is missing: the weights folder is incomplete (it holds {listing(folder)}), "
                              "download or copy it again")
    if is_lfs_pointer(file):
        raise CheckpointError(f"{file} {lfs_remedy(folder)}")
    return file


@checkpoint_errors()
def read_json(file: Path) -> dict:
    """A JSON object."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CheckpointError(f"{file} cannot be read ({error}): download or copy it again") from error
    if not isinstance(content, dict):
        raise CheckpointError(f"{file} does not hold a JSON object: found {type(content).__name__}")
    return content


def is_lfs_pointer(path: str | Path) -> bool:
    """Whether the file is a text of Git LFS that stands for the real one. Raises OSError."""
    with open(path, "rb") as file:
        return file.read(len(LFS_POINTER)) == LFS_POINTER


def lfs_remedy(folder: str | Path) -> str:
    """What to do about such a text, for messages that begin with its name."""
    return f"stands for a file that was not downloaded: run `git lfs pull` in {folder}, or download it by itself"
