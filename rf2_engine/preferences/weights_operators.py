# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons for weights: download the published ones, stop, remove them; free the memory of the loaded network."""
from __future__ import annotations

import shutil

import bpy

from ...model.published import latent_store
from ...model.published.as_trained import TRIANGLES, WELL_KNOWN
from ..registering import classes
from ..runtime import model_cache, running
from ..setup import display, extension, packages, published_weights, weights_download
from . import preferences

RENDERING = "A render is running"


def is_rendering() -> bool:
    """Whether a render may be using the network."""
    return running.is_under_way() or bpy.app.is_job_running("RENDER")


def refusal() -> str:
    """Why nothing can be downloaded now, or ""."""
    if message := extension.offline():
        return message
    if published_weights.download_folder() is None:
        return "The add-on runs from its source folder: install it as an extension to download weights"
    if "huggingface_hub" in packages.missing(packages.PUBLISHED):
        return "Install the packages for the published weights first"
    return RENDERING if is_rendering() else ""


class _Download(bpy.types.Operator):
    @classmethod
    def poll(cls, context):
        if message := refusal():
            cls.poll_message_set(message)
        return not message and not weights_download.current.is_running

    def run(self, download: weights_download.Download) -> set[str]:
        if not bpy.app.background:
            display.keep_redrawing()
            return {"FINISHED"}
        download.wait()  # for a script the operator returns when all is done
        if download.state == "failed":
            self.report({"ERROR"}, download.explanation)
            return {"CANCELLED"}
        return {"FINISHED"}


class RENDERFORMER_OT_download_weights(_Download):
    bl_idname = "renderformer_v2.download_weights"
    bl_label = "Download..."
    bl_description = ("Ask the Hugging Face Hub for the size of the published weights (RenderFormer/renderformer-v2, "
                      "and the VAE of Qwen/Qwen-Image). You see the size before anything is downloaded")

    def execute(self, context):
        return self.run(weights_download.current.begin(published_weights.download_folder(), preferences.session.token,
                                                       preferences.networks()))


class RENDERFORMER_OT_fetch_weights(_Download):
    bl_idname = "renderformer_v2.fetch_weights"
    bl_label = "Download"
    bl_description = "Download what is missing. A cancelled download resumes where it stopped"

    @classmethod
    def poll(cls, context):
        download = weights_download.current.process
        return super().poll(context) and download is not None and download.state == "ready"

    def execute(self, context):
        model_cache.free()  # its files are mapped, which Windows would not let us replace
        weights_download.current.process.fetch()
        return self.run(weights_download.current.process)


class RENDERFORMER_OT_cancel_download(bpy.types.Operator):
    bl_idname = "renderformer_v2.cancel_download"
    bl_label = "Cancel"
    bl_description = "Stop the download. It can be resumed later"

    @classmethod
    def poll(cls, context):
        return weights_download.current.process is not None

    def execute(self, context):
        weights_download.current.forget()
        return {"FINISHED"}


class RENDERFORMER_OT_remove_weights(bpy.types.Operator):
    bl_idname = "renderformer_v2.remove_weights"
    bl_label = "Remove"
    bl_description = "Delete the downloaded weights, even incomplete ones. Folders that you chose are not touched"

    @classmethod
    def poll(cls, context):
        folder = published_weights.download_folder()
        if extension.shared_folder(published_weights.WEIGHTS_VARIABLE):
            return False  # others use them
        return folder is not None and folder.is_dir() and not weights_download.current.is_running and not is_rendering()

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context):
        weights_download.current.forget()
        model_cache.free()
        try:
            shutil.rmtree(published_weights.download_folder())
        except OSError as error:
            self.report({"ERROR"}, f"Not everything could be removed: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}


class RENDERFORMER_OT_remove_latents(bpy.types.Operator):
    bl_idname = "renderformer_v2.remove_latents"
    bl_label = "Delete Encoded Textures"
    bl_description = "Delete the encoded textures that are kept for later renders. The next render encodes them again"

    @classmethod
    def poll(cls, context):
        file = published_weights.latents_file()
        return file is not None and file.is_file() and not is_rendering()

    def execute(self, context):
        model_cache.free()  # it holds the file open
        try:
            for file in latent_store.files(published_weights.latents_file()):
                file.unlink(missing_ok=True)
        except OSError as error:
            self.report({"ERROR"}, f"The encoded textures could not be deleted: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}


class RENDERFORMER_OT_suggested_budget(bpy.types.Operator):
    bl_idname = "renderformer_v2.suggested_budget"
    bl_label = "Max Triangles for These Weights"
    bl_description = (f"Set Max Triangles to {WELL_KNOWN}, which the published weights know well. They were trained "
                      f"with up to {TRIANGLES}, if memory and time allow")
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        context.scene.renderformer_v2.token_budget = WELL_KNOWN
        return {"FINISHED"}


class RENDERFORMER_OT_free_model(bpy.types.Operator):
    bl_idname = "renderformer_v2.free_model"
    bl_label = "Free Memory"
    bl_description = "Remove the network from main memory and GPU memory. The next render loads it again in seconds"

    @classmethod
    def poll(cls, context):
        if is_rendering():
            cls.poll_message_set(RENDERING)
            return False
        return model_cache.is_loaded()

    def execute(self, context):
        model_cache.free()
        return {"FINISHED"}


register, _unregister = classes(
    RENDERFORMER_OT_download_weights, RENDERFORMER_OT_fetch_weights, RENDERFORMER_OT_cancel_download,
    RENDERFORMER_OT_remove_weights, RENDERFORMER_OT_remove_latents, RENDERFORMER_OT_suggested_budget,
    RENDERFORMER_OT_free_model)


def unregister() -> None:
    weights_download.current.forget()
    display.unregister()
    _unregister()
