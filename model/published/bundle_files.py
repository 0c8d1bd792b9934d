# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the published bundle (docs/scene-input.md 12), and which weights a folder holds; without PyTorch."""
from __future__ import annotations

from os.path import isdir, isfile
from pathlib import Path

from ..errors import CheckpointError
from ..weights.files import checkpoint_errors, described, listing, weights_file

INDEX = "model_index.json"  # of the whole; nothing is read from it
MODEL_CONFIG = "model_config.json"  # of a transformer that was saved by itself; it counts before the others
CONFIG = ("config.json",)
TRANSFORMER = (MODEL_CONFIG, "config.yaml", "config.yml")
SMALL, LARGE = TRANSFORMERS = ("transformer_512", "transformer_2048")
MAPPERS = ("diffspec_mapper", "metallic_mapper", "metallic_transmission_mapper")
COMPONENTS = {  # folder: names of which one describes it
    SMALL: TRANSFORMER, LARGE: TRANSFORMER, "material_autoencoder": CONFIG, **dict.fromkeys(MAPPERS, CONFIG)}
LARGE_RESOLUTION = 2048  # pixels from which the second transformer was trained
AUTOMATIC = "auto"


def is_bundle(folder: str | Path) -> bool:
    """Whether the folder is a published bundle, what a partial download left of it, or one transformer of it.

    Raises OSError.
    """
    return is_transformer(folder) or any((Path(folder) / name).exists() for name in (INDEX, *COMPONENTS))


def is_transformer(folder: str | Path) -> bool:
    """Whether it holds one transformer by itself, as the authors' `save_pretrained` writes it. Raises OSError."""
    return any((Path(folder) / name).is_file() for name in TRANSFORMER)


def bundle_and_transformer(folder: Path, chosen: str = AUTOMATIC) -> tuple[Path, str]:
    """The bundle, and which of its transformers is chosen: a chosen transformer's folder lies in its bundle."""
    return (folder.absolute().parent, folder.absolute().name) if is_transformer(folder) else (folder, chosen)


def transformer_for(bundle: Path, picture_size: int, chosen: str = AUTOMATIC) -> str:
    """The folder of the network for pictures whose longer side has so many pixels: the chosen one, of TRANSFORMERS or
    beside them.

    Automatic takes the one that was trained for that size, or the only one that is there.
    """
    if chosen != AUTOMATIC:
        return chosen
    wanted, other = (LARGE, SMALL) if picture_size >= LARGE_RESOLUTION else (SMALL, LARGE)
    return other if isdir(bundle / other) and not isdir(bundle / wanted) else wanted


def missing_parts(bundle: Path, chosen: str = AUTOMATIC) -> list[str]:
    """What a render would not find: one transformer, or the chosen one, and all mappers are needed, the VAE is
    elsewhere.

    Names of files are proof enough: a download gives them to complete files only.
    """
    def complete(name: str) -> bool:  # False where a path may not be looked at, and no error
        return isfile(bundle / name / "model.safetensors") and any(
            isfile(bundle / name / config) for config in COMPONENTS.get(name, TRANSFORMER))

    wanted = TRANSFORMERS if chosen == AUTOMATIC else (chosen,)
    parts = [] if any(map(complete, wanted)) else [" or ".join(wanted)]
    return parts + [name for name in MAPPERS if not complete(name)]


@checkpoint_errors()
def require_parts(bundle: Path, chosen: str = AUTOMATIC) -> None:
    """Raises CheckpointError unless the bundle holds what a render with the chosen transformer needs."""
    parts = missing_parts(bundle, chosen)
    if parts and chosen not in (AUTOMATIC, *parts):
        raise CheckpointError(f"A render with the transformer {bundle / chosen} also needs {', '.join(parts)} beside "
                              f"it, but {bundle} holds {listing(bundle)}: download or copy the folder renderformer-v2 "
                              "whole. A transformer that was saved by itself belongs into it")
    if parts:
        raise CheckpointError(f"{bundle} is incomplete: a render needs {', '.join(parts)}, each a folder with its "
                              f"configuration and model.safetensors, and it holds {listing(bundle)}. Download or copy "
                              "them again")


@checkpoint_errors()
def check_weights(folder: Path) -> None:
    """Look for a published bundle or a network of ours in a folder, as a render does before it reads tensors.

    Raises CheckpointError with the path and what to do.
    """
    if is_bundle(folder):
        require_parts(*bundle_and_transformer(folder))
    else:
        described(folder)
        weights_file(folder)
