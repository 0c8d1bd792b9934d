# SPDX-License-Identifier: GPL-3.0-or-later
"""Add-on preferences: the Python packages and the published weights."""
from __future__ import annotations

from os.path import isdir

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...model.published.bundle_files import LARGE, SMALL, TRANSFORMERS
from ..runtime import model_cache
from ..setup import extension, packages, published_weights, weights_download
from ..setup.display import draw_progress, draw_steps, draw_text, format_size, free_space
from . import package_panel


class Session:
    """Kept for this session only, whereas properties are saved with the preferences. There is one: `session`."""

    token = ""  # access token of the Hugging Face Hub


session = Session()


def networks() -> tuple[str, ...]:
    """The names in bundle_files.TRANSFORMERS that are to be downloaded."""
    choice = extension.preferences().networks
    return TRANSFORMERS if choice == "BOTH" else (SMALL if choice == "SMALL" else LARGE,)


def _set_token(self, value: str) -> None:
    session.token = "".join(value.split())  # copied text may have a line break


class RenderFormerPreferences(bpy.types.AddonPreferences):
    bl_idname = extension.EXTENSION

    torch_build: EnumProperty(
        name="PyTorch", description="Build of PyTorch to install on Linux and Windows", default="AUTO",
        items=(("AUTO", "Automatic", "For CUDA where an NVIDIA driver is found, else for the CPU", 0),
               ("CUDA", "CUDA", "For NVIDIA GPUs and the CPU: 3 GB to download, 5.5 GB on disk", 1),
               ("CPU", "CPU", "For the CPU only: 0.2 GB to download", 2)),
    )
    torch_cpu_index: StringProperty(
        name="CPU Build From", default="https://download.pytorch.org/whl/cpu",
        description="Address of the package index for PyTorch's CPU build",
    )
    torch_cuda_index: StringProperty(
        name="CUDA Build From", default="https://download.pytorch.org/whl/cu132",
        description="Address of the package index for PyTorch's CUDA build for Windows. Its end names the release of "
                    "CUDA: for cards before Turing (GTX 16, RTX 20) and for older drivers, choose cu126 if PyTorch "
                    "offers it",
    )
    package_index: StringProperty(
        name="Package Index",
        description="Address of the package index for all other packages. Leave empty to use the Python Package Index",
    )
    weights_folder: StringProperty(
        name="Weights Folder", subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="A copy of renderformer-v2 on this computer, with the VAE of Qwen-Image in its folder vae or in "
                    "Qwen-Image/vae beside it. If empty, the downloaded weights are used",
    )
    networks: EnumProperty(
        name="Network Resolution", default="SMALL",
        description="The size of the pictures that the networks to download were trained with",
        items=(("SMALL", "512", "Trained for pictures of 512 x 512 pixels: 0.8 GB", 0),
               ("LARGE", "2048", "Trained for pictures of 2048 x 2048 pixels: 0.8 GB", 1),
               ("BOTH", "Both", "Pictures from 2048 pixels are drawn by the second: 1.7 GB", 2)),
    )
    access_token: StringProperty(
        name="Access Token", subtype="PASSWORD", options={"SKIP_SAVE"}, get=lambda self: session.token, set=_set_token,
        description="Token of your Hugging Face account. It is not saved when Blender is closed",
    )

    show_reference: BoolProperty(
        name="Compare With a Cycles Reference", default=True,
        description="While Cycles renders a reference, and after that, the Image Editor shows the picture and the "
                    "reference, divided by a line. The button Compare in its header switches that off and on",
    )

    def draw(self, context):
        layout = self.layout
        layout.prop(self, "show_reference")
        layout.label(text="Python packages")
        box = layout.box()
        package_panel.draw_packages(box, packages.PACKAGES)
        package_panel.draw_choices(box)
        is_used = _are_weights_used(self)
        layout.label(text="Published weights" if is_used else "Published weights: not downloaded (optional)")
        box = layout.box()
        _draw_status(box, is_used)
        if not self.weights_folder:
            package_panel.draw_packages(box, packages.PUBLISHED, published=True)
            _draw_download(box, self)
        if shared := extension.shared_folder(published_weights.WEIGHTS_VARIABLE):
            box.label(text=f"{published_weights.WEIGHTS_VARIABLE} names {shared}", icon="INFO")
        else:
            box.prop(self, "weights_folder")
        if model_cache.is_loaded():
            layout.operator("renderformer_v2.free_model")


def _are_weights_used(preferences: RenderFormerPreferences) -> bool:
    """Whether a folder was chosen or a part of the weights was downloaded, so that missing parts matter."""
    folder = published_weights.download_folder()
    return bool(preferences.weights_folder or extension.shared_folder(published_weights.WEIGHTS_VARIABLE)
                or folder and folder.is_dir())


def _draw_status(layout, is_used: bool) -> None:
    bundle = published_weights.bundle_folder()
    if bundle is None:
        layout.label(text="The add-on runs from its source folder: choose a folder with the weights", icon="INFO")
        return
    if is_used:
        missing = published_weights.missing_parts(bundle) if isdir(bundle) else ["everything"]
        if missing:
            draw_text(layout, f"Missing: {', '.join(missing)}")
        else:
            layout.label(text="Complete", icon="CHECKMARK")
    folder = published_weights.download_folder()
    if folder and folder.is_dir():
        layout.label(text=f"{format_size(published_weights.size_on_disk(folder))} downloaded to {folder}")
        layout.operator("renderformer_v2.remove_weights", icon="TRASH")
    latents = published_weights.latents_file()
    if latents and latents.is_file():
        layout.label(text=f"{format_size(latents.stat().st_size)} of encoded textures kept for later renders")
        layout.operator("renderformer_v2.remove_latents", icon="TRASH")


def _draw_download(layout, preferences: RenderFormerPreferences) -> None:
    download, offline = weights_download.current.process, extension.offline()
    if offline and not packages.missing(packages.PUBLISHED):  # otherwise the button for them says so
        layout.label(text=offline, icon="INTERNET_OFFLINE")
    if download is None or download.state in ("done", "failed", "cancelled"):
        if download and download.state == "failed":
            draw_text(layout, download.error)
            draw_steps(layout, download.steps)
            if download.needs_token or session.token:
                layout.prop(preferences, "access_token")
        row = layout.row()
        row.label(text="Network Resolution:")
        row.prop(preferences, "networks", expand=True)
        layout.operator("renderformer_v2.download_weights", icon="IMPORT")
        return
    if download.state == "ready":
        missing, free = format_size(download.total - download.present), format_size(free_space(download.target))
        present = f" ({format_size(download.present)} are already here)" if download.present else ""
        layout.label(text=f"{missing} to download{present}, {free} free on the disk")
        layout.operator("renderformer_v2.fetch_weights", text=f"Download {missing}", icon="IMPORT")
    else:
        draw_progress(layout, download, progress_text(download))
    layout.operator("renderformer_v2.cancel_download", icon="CANCEL")


def progress_text(download: weights_download.Download) -> str:
    """"12 %, 210.3 MB of 1.75 GB  transformer_512/model.safetensors"."""
    if not download.total:
        return download.text
    percent = 100 * download.present // download.total
    return f"{percent} %, {format_size(download.present)} of {format_size(download.total)}  {download.text}"


def register() -> None:
    bpy.utils.register_class(RenderFormerPreferences)


def unregister() -> None:
    _set_token(None, "")
    bpy.utils.unregister_class(RenderFormerPreferences)
