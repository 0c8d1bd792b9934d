# SPDX-License-Identifier: GPL-3.0-or-later
"""The published weights on this computer: where they are and whether they are complete (docs/scene-input.md 12)."""
from __future__ import annotations

import os
from os.path import isdir, isfile
from pathlib import Path

import bpy

from ...model.errors import CheckpointError
from ...model.published import bundle_files
from ...model.published.bundle_files import is_bundle
from . import extension

WEIGHTS_VARIABLE = "RENDERFORMER_V2_WEIGHTS"  # environment: renderformer-v2, or the folder that contains it
NEEDED = (*bundle_files.TRANSFORMERS, *bundle_files.MAPPERS)  # for a render
BUNDLE, VAE = "renderformer-v2", "Qwen-Image"
# A "revision" of None is the head. "sha256" has the known hashes of files, which downloads must have.
REPOSITORIES = [
    {"id": "RenderFormer/renderformer-v2", "revision": None, "folder": BUNDLE,
     "parts": [bundle_files.INDEX, *(f"{name}/" for name in NEEDED)], "sha256": {}},
    {"id": "Qwen/Qwen-Image", "revision": "75e0b4be04f60ec59a75f475837eced720f823b6",  # docs/scene-input.md 4.5
     "folder": VAE, "parts": ["vae/"], "sha256": {}},
]


def repositories(transformers: tuple[str, ...]) -> list[dict]:
    """REPOSITORIES without the other ones of bundle_files.TRANSFORMERS."""
    unwanted = {f"{name}/" for name in bundle_files.TRANSFORMERS if name not in transformers}
    return [entry | {"parts": [part for part in entry["parts"] if part not in unwanted]} for entry in REPOSITORIES]


def download_folder() -> Path | None:
    """Where downloads go: the shared folder, or under Blender's path for this extension.

    None when run from the source tree without a shared one.
    """
    if shared := extension.shared_folder(WEIGHTS_VARIABLE):
        return shared.parent if is_bundle(shared) else shared
    return extension.user_folder("weights")


def latents_file() -> Path | None:
    """The file that keeps encoded textures between renders, of limited size; None when run from the source tree."""
    folder = extension.user_folder("latents")
    return folder and folder / "latents.sqlite"


def bundle_folder() -> Path | None:
    """The folder of renderformer-v2, whether it exists or not: shared, or else the user's own, or else downloaded."""
    if shared := extension.shared_folder(WEIGHTS_VARIABLE):
        return shared if is_bundle(shared) else shared / BUNDLE
    if chosen := _chosen_folder():
        return Path(bpy.path.abspath(chosen)).expanduser()
    folder = download_folder()
    return folder and folder / BUNDLE


def _chosen_folder() -> str:
    """The folder in the preferences, or ""."""
    preferences = extension.preferences()
    return preferences.weights_folder if preferences else ""


def missing_parts(bundle: Path) -> list[str]:
    """The parts that a render needs and that are missing, the VAE included."""
    bundle, chosen = bundle_files.bundle_and_transformer(bundle)
    parts = bundle_files.find_missing_parts(bundle, chosen)
    # The folders in which find_vae of the image encoder looks, which cannot be imported without torch.
    vae = bundle / "vae" if isdir(bundle / "vae") else bundle.parent / VAE / "vae"
    if not all(isfile(vae / name) for name in ("config.json", "diffusion_pytorch_model.safetensors")):
        parts.append(f"{VAE}/vae")
    return parts


def require() -> Path:
    """The folder of the complete bundle. Raises CheckpointError, which says how to get it."""
    bundle = bundle_folder()
    parts = missing_parts(bundle) if bundle else []
    if bundle and not parts:
        return bundle
    what = "on this computer"
    if bundle and isdir(bundle):
        readable = os.access(bundle, os.R_OK | os.X_OK)
        what = f"in {bundle}: {', '.join(parts)}" if readable else f": {bundle} may not be read"
    elif extension.shared_folder(WEIGHTS_VARIABLE) or _chosen_folder():
        what = f": there is no folder {bundle}"
    raise CheckpointError(f"The published weights are not complete {what}. {_remedy()}; or set Weights to Bundled")


def _remedy() -> str:
    if extension.shared_folder(WEIGHTS_VARIABLE):
        return (f"The environment variable {WEIGHTS_VARIABLE} says where: correct it, or download them there "
                "with blender --online-mode --command renderformer_v2 install --download")
    return "Download them, or choose a folder that has them, in Preferences > Add-ons > RenderFormer-V2"


def size_on_disk(folder: Path) -> int:
    """Bytes of all files in a folder, including unfinished ones."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
