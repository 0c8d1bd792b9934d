# SPDX-License-Identifier: GPL-3.0-or-later
"""Add-on preferences: the published weights, how to get them and where they are."""
from __future__ import annotations

import shutil
import textwrap
from os.path import isdir
from pathlib import Path

import bpy
from bpy.props import StringProperty

from .. import model_cache
from . import packages, published_weights, weights_download

_token = ""  # only for this session: a property of Blender's own would be saved with the preferences


def token() -> str:
    return _token


def _set_token(self, value: str) -> None:
    global _token
    _token = "".join(value.split())  # copied over a line's end


class RenderFormerPreferences(bpy.types.AddonPreferences):
    bl_idname = packages.EXTENSION

    weights_folder: StringProperty(
        name="Own Folder", subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="A copy of renderformer-v2 on this computer, with the VAE of Qwen-Image as its folder vae or in "
                    "Qwen-Image/vae beside it. Empty: the downloaded weights are used",
    )
    access_token: StringProperty(
        name="Access Token", subtype="PASSWORD", options={"SKIP_SAVE"}, get=lambda self: _token, set=_set_token,
        description="Token of your Hugging Face account. It is forgotten when Blender is closed",
    )

    def draw(self, context):
        layout = self.layout
        layout.label(text="Published weights")
        box = layout.box()
        _draw_status(box)
        if not self.weights_folder:
            _draw_packages(box)
            _draw_download(box, self)
        box.prop(self, "weights_folder")
        if model_cache.is_loaded():
            layout.operator("renderformer_v2.free_model")


def _draw_status(layout) -> None:
    bundle = published_weights.bundle_folder()
    if bundle is None:
        layout.label(text="The add-on runs from its source folder: choose a folder with the weights", icon="INFO")
        return
    missing = published_weights.missing_parts(bundle) if isdir(bundle) else ["everything"]
    if missing:
        _draw_text(layout, f"Missing: {', '.join(missing)}")
    else:
        layout.label(text="Complete", icon="CHECKMARK")
    folder = published_weights.download_folder()
    if folder and folder.is_dir():
        layout.label(text=f"{amount(published_weights.size_on_disk(folder))} downloaded to {folder}")
        layout.operator("renderformer_v2.remove_weights", icon="TRASH")


def _draw_text(layout, text: str) -> None:
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, 70)):
        column.label(text=line, icon="BLANK1" if number else "ERROR")


def _draw_packages(layout) -> None:
    missing = packages.missing(packages.PUBLISHED)
    if missing:
        layout.label(text=f"Missing Python packages: {', '.join(missing)}", icon="ERROR")
        layout.operator("renderformer_v2.install_runtime", icon="IMPORT").published = True


def _draw_download(layout, preferences: RenderFormerPreferences) -> None:
    download, offline = weights_download.current, packages.offline()
    if offline:
        layout.label(text=offline, icon="INTERNET_OFFLINE")
    if download is None or download.state in ("done", "failed", "cancelled"):
        if download and download.state == "failed":
            _draw_text(layout, download.error)
            if download.needs_token or token():
                layout.prop(preferences, "access_token")
        layout.operator("renderformer_v2.download_weights", icon="IMPORT")
        return
    if download.state == "ready":
        left = download.total - download.present
        have = f" ({amount(download.present)} are here)" if download.present else ""
        layout.label(text=f"{amount(left)} to download{have}, {amount(free_space(download.target))} free on the disk")
        layout.operator("renderformer_v2.fetch_weights", text=f"Download {amount(left)}", icon="IMPORT")
    else:
        layout.progress(factor=download.present / max(download.total, 1), text=progress_text(download))
    layout.operator("renderformer_v2.cancel_download", icon="CANCEL")


def progress_text(download: weights_download.Download) -> str:
    """"12 %, 210.3 MB of 1.75 GB  transformer_512/model.safetensors", and for how long nothing has come."""
    text = download.text
    if download.total:
        text = (f"{100 * download.present // download.total} %, {amount(download.present)} of "
                f"{amount(download.total)}  {text}")
    silent = download.silent_seconds
    return text if silent < 5 else f"{text} (no data for {silent:.0f} s)"


def amount(size: int) -> str:
    """Bytes as "1.75 GB" or "210.3 MB"."""
    return f"{size / 1e9:.2f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def free_space(folder: Path) -> int:
    """Bytes on the disk where the folder is or will be."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def register() -> None:
    bpy.utils.register_class(RenderFormerPreferences)


def unregister() -> None:
    _set_token(None, "")
    bpy.utils.unregister_class(RenderFormerPreferences)
