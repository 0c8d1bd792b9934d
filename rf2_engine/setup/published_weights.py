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
from . import packages, shared_folders

NEEDED = (*bundle_files.TRANSFORMERS, *bundle_files.MAPPERS)  # by a render
BUNDLE, VAE = "renderformer-v2", "Qwen-Image"
# A "revision" of None is the head; "sha256" of a file, where it is known, is asked of whatever the Hub sends.
REPOSITORIES = [
    {"id": "RenderFormer/renderformer-v2", "revision": None, "folder": BUNDLE,
     "parts": [bundle_files.INDEX, *(f"{name}/" for name in NEEDED)], "sha256": {}},
    {"id": "Qwen/Qwen-Image", "revision": "75e0b4be04f60ec59a75f475837eced720f823b6",  # docs/scene-input.md 4.5
     "folder": VAE, "parts": ["vae/"], "sha256": {}},
]


def repositories(transformers: tuple[str, ...]) -> list[dict]:
    """REPOSITORIES with no more than these of bundle_files.TRANSFORMERS."""
    unwanted = {f"{name}/" for name in bundle_files.TRANSFORMERS if name not in transformers}
    return [entry | {"parts": [part for part in entry["parts"] if part not in unwanted]} for entry in REPOSITORIES]


def download_folder() -> Path | None:
    """Where downloads go: the shared folder, or under Blender's path for this extension.

    None when run from the source tree without a shared one.
    """
    if shared := shared_folders.named(shared_folders.WEIGHTS):
        return shared.parent if is_bundle(shared) else shared
    if not packages.is_extension():
        return None
    return Path(bpy.utils.extension_path_user(packages.EXTENSION, path="weights"))


def latents_file() -> Path | None:
    """Where encoded textures are kept between renders, of limited size; None when run from the source tree."""
    if not packages.is_extension():
        return None
    return Path(bpy.utils.extension_path_user(packages.EXTENSION, path="latents")) / "latents.sqlite"


def bundle_folder() -> Path | None:
    """The folder of renderformer-v2: the shared one, else the user's own, else the downloaded one, there or not."""
    if shared := shared_folders.named(shared_folders.WEIGHTS):
        return shared if is_bundle(shared) else shared / BUNDLE
    chosen = packages.preferences() and packages.preferences().weights_folder
    if chosen:
        return Path(bpy.path.abspath(chosen)).expanduser()
    folder = download_folder()
    return folder and folder / BUNDLE


def missing_parts(bundle: Path) -> list[str]:
    """What a render would not find, the VAE included."""
    bundle, chosen = bundle_files.bundle_and_transformer(bundle)
    parts = bundle_files.missing_parts(bundle, chosen)
    # The places where model.image_encoder.find_vae looks; it cannot be asked without importing torch.
    vae = bundle / "vae" if isdir(bundle / "vae") else bundle.parent / VAE / "vae"
    if not all(isfile(vae / name) for name in ("config.json", "diffusion_pytorch_model.safetensors")):
        parts.append(f"{VAE}/vae")
    return parts


def require() -> Path:
    """The complete bundle's folder. Raises CheckpointError that says how to get it."""
    bundle = bundle_folder()
    parts = missing_parts(bundle) if bundle else []
    if bundle and not parts:
        return bundle
    what = "on this computer"
    if bundle and isdir(bundle):
        readable = os.access(bundle, os.R_OK | os.X_OK)
        what = f"in {bundle}: {', '.join(parts)}" if readable else f": {bundle} may not be read"
    elif shared_folders.named(shared_folders.WEIGHTS) or (packages.preferences()
                                                          and packages.preferences().weights_folder):
        what = f": there is no folder {bundle}"
    raise CheckpointError(f"The published weights are not complete {what}. {_remedy()}; or set Weights to Bundled")


def _remedy() -> str:
    if shared_folders.named(shared_folders.WEIGHTS):
        return (f"The environment variable {shared_folders.WEIGHTS} says where: correct it, or download them there "
                "with blender --online-mode --command renderformer_v2 install --download")
    return "Download them, or choose a folder that has them, in Preferences > Add-ons > RenderFormer-V2"


def size_on_disk(folder: Path) -> int:
    """Bytes of all files in a folder, unfinished ones too."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
