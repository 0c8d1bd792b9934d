# SPDX-License-Identifier: GPL-3.0-or-later
"""Which files weights consist of, without importing PyTorch; what is missing or unreadable is a CheckpointError."""
from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path

from .errors import CheckpointError
from .presets import weights_folder
from .published.bundle_files import INDEX, is_bundle

PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl")


@contextmanager
def explained():
    """What the operating system refuses becomes a CheckpointError; around everything that looks into folders."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"{error.filename} cannot be read ({error.strerror}): check its permissions") from error


@explained()
def check(weights: str | Path) -> None:
    """Raises CheckpointError where a preset, or a folder, is none of weights; the files' content is not looked at."""
    folder = weights_folder(weights)
    if is_bundle(folder):
        require(folder, INDEX)  # the other parts are read when a picture asks for them
    else:
        description_file(folder, "config.json")
        weights_file(folder)


@explained()
def description_file(folder: Path, name: str) -> Path:
    """The file that describes the network of one folder in this project's format."""
    if folder.is_dir() and not (folder / name).is_file():
        raise CheckpointError(f"{folder} holds no weights: choose the folder renderformer-v2 (with model_index.json), "
                              f"or one that tools.train.network wrote (with {name})")
    return require(folder, name)


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


@explained()
def require(folder: Path, name: str) -> Path:
    """folder / name, which must exist."""
    if folder.suffix in PICKLES:
        raise CheckpointError(f"{folder} is a pickle, which can run any program when opened: use safetensors weights")
    if folder.is_file():
        raise CheckpointError(f"{folder} is a file: choose the folder that it lies in")
    if not folder.is_dir():
        raise CheckpointError(f"there is no weights folder {folder}")
    file = folder / name
    if not file.is_file():
        raise CheckpointError(f"{file} is missing: the weights folder is incomplete, download or copy it again")
    return file


@explained()
def read_json(file: Path) -> dict:
    """A JSON object."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CheckpointError(f"{file} cannot be read ({error}): download or copy it again") from error
    if not isinstance(content, dict):
        raise CheckpointError(f"{file} does not hold a JSON object")
    return content
