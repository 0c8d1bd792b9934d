# SPDX-License-Identifier: GPL-3.0-or-later
"""Material Properties: settings, and the appearance latent, nine numbers in place of the nodes (published weights)."""
from __future__ import annotations

from multiprocessing.pool import ThreadPool
from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...model import progress
from ...model.errors import CheckpointError, RenderCancelled, SceneError
from ...model.material.measured import SUFFIXES, grey_light
from ..frame_settings import is_published
from ..material_settings import read_latent, set_latent
from ..picture_files import read_pixels, studio_light_file
from ..registering import classes
from ..setup import importing, published_weights
from ..setup.display import INTERVAL, draw_text
from ..setup.packages import MissingPackages
from .panel import EnginePanel

SPHERE = 256  # pixels, width and height of the pictures of spheres
PICTURE = "Latent of {}"
FAILURES = ValueError, OSError, RuntimeError, CheckpointError, SceneError, MissingPackages


class RENDERFORMER_PT_material_settings(EnginePanel):
    bl_label = "Settings"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.material and super().poll(context)

    def draw(self, context):
        layout = self.split_layout()
        layout.prop(context.material, "pass_index")
        layout.prop(context.material, "displacement_method", text="Displacement")
        layout.prop(context.material, "use_transparent_shadow")


class RENDERFORMER_PT_material_latent(EnginePanel):
    bl_label = "Appearance Latent"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Show it for published weights, and for materials that have a latent already."""
        return context.material and super().poll(context) and (
            is_published(context.scene.renderformer_v2) or context.material.renderformer_v2.use_latent)

    def draw_header(self, context):
        self.layout.prop(context.material.renderformer_v2, "use_latent", text="")

    def draw(self, context):
        layout, settings = self.layout, context.material.renderformer_v2
        if not is_published(context.scene.renderformer_v2):
            draw_text(layout, "Only published weights know it: others render the nodes", icon="INFO")
        layout = layout.column()
        layout.active = settings.use_latent
        layout.operator("renderformer_v2.load_latent", icon="FILE_FOLDER")
        grid = layout.grid_flow(row_major=True, columns=3, align=True)
        for i in range(len(settings.latent)):
            grid.prop(settings, "latent", index=i, text="")
        picture = bpy.data.images.get(PICTURE.format(context.material.name))
        if picture is not None and picture.preview:
            layout.template_icon(icon_value=picture.preview.icon_id, scale=6)
        layout.operator("renderformer_v2.show_latent", icon="MATERIAL")


class _WithMaterial(bpy.types.Operator):
    @classmethod
    def poll(cls, context):
        return getattr(context, "material", None) is not None


class RENDERFORMER_OT_load_latent(_WithMaterial, ImportHelper):
    bl_idname = "renderformer_v2.load_latent"
    bl_label = "Load Latent"
    bl_description = ("From a .npy file of nine numbers; from a picture of a sphere of the material, 256 x 256 linear "
                      "radiance as the authors' material pictures show it, by the published autoencoder; or from a "
                      "measured BRDF of the RGL (.bsdf) or MERL (.binary) database, by the bundled one. The last takes "
                      "a minute, Esc stops it")
    bl_options = {"UNDO"}

    filter_glob: StringProperty(default="*.npy;*.exr;*.hdr;*.bsdf;*.binary", options={"HIDDEN"})

    def execute(self, context):
        file, material = Path(self.filepath), context.material
        self.key = material.name, material.library and material.library.filepath  # it may be gone before the end
        if file.suffix.lower() not in SUFFIXES:
            return self.finish(lambda: read_latent(file) if file.suffix.lower() == ".npy"
                               else encode_sphere(read_radiance(file)))
        try:
            self.encoding = Encoding(file, context.scene.renderformer_v2)
        except FAILURES as error:
            return self.fail(error)
        if bpy.app.background:
            return self.finish(self.encoding.wait)
        self.timer = context.window_manager.event_timer_add(INTERVAL, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self.encoding.is_cancelled = True
        if self.encoding.is_running:
            context.workspace.status_text_set(f"Encoding {Path(self.filepath).name}, "
                                              f"{100 * self.encoding.fraction:.0f} %  (Esc: Cancel)")
            return {"PASS_THROUGH"}
        self.cancel(context)
        return self.finish(self.encoding.wait)

    def cancel(self, context):
        """Also called by Blender, such as when another file is opened."""
        self.encoding.is_cancelled = True
        context.window_manager.event_timer_remove(self.timer)
        context.workspace.status_text_set(None)

    def finish(self, read):
        """read(): the latent."""
        try:
            numbers = read()
            if (material := bpy.data.materials.get(self.key)) is not None:
                set_latent(material, numbers)
        except RenderCancelled:
            return {"CANCELLED"}
        except FAILURES as error:
            return self.fail(error)
        return {"FINISHED"}

    def fail(self, error: Exception):
        self.report({"ERROR"}, f"{Path(self.filepath).name}: {error}")
        return {"CANCELLED"}


class Encoding:
    """The latent of a measured BRDF, on a thread of its own: rendering its sphere takes a minute."""

    def __init__(self, file: Path, settings):
        """Raises CheckpointError for weights that do not know such latents, MissingPackages, OSError."""
        importing.import_packages()
        if is_published(settings):
            require_bundled_latents(Path(settings.weights()))
        self.is_cancelled, self.fraction = False, 0.0
        light = read_pixels(studio_light_file("studio"))
        pool = ThreadPool(1)
        self._result = pool.apply_async(self._run, (file, light))
        pool.close()  # its threads end with the work

    @property
    def is_running(self) -> bool:
        return not self._result.ready()

    def wait(self) -> np.ndarray:
        """(9,) f32. Raises SceneError for the file, RenderCancelled."""
        return self._result.get()

    def _run(self, file: Path, light: np.ndarray) -> np.ndarray:
        from ...model.material.measured_latent import encode_brdf
        with progress.reporting(self._listen):
            return encode_brdf(file, grey_light(light))[0]

    def _listen(self, text: str, fraction: float) -> None:
        self.fraction = fraction
        if self.is_cancelled:
            raise RenderCancelled


class RENDERFORMER_OT_show_latent(_WithMaterial):
    bl_idname = "renderformer_v2.show_latent"
    bl_label = "Show Latent"
    bl_description = "Draw the sphere that the published autoencoder sees in the latent, as a small picture here"

    def execute(self, context):
        material = context.material
        try:
            pixels = decode_sphere(np.float32(material.renderformer_v2.latent))
        except (CheckpointError, MissingPackages) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        name = PICTURE.format(material.name)
        if (old := bpy.data.images.get(name)) is not None:
            bpy.data.images.remove(old)
        height, width, _ = pixels.shape
        image = bpy.data.images.new(name, width, height, float_buffer=True)
        image.pixels.foreach_set(np.pad(pixels[::-1], ((0, 0), (0, 0), (0, 1)), constant_values=1).ravel())
        image.pack()  # it has no file
        image.preview_ensure()
        return {"FINISHED"}


def read_radiance(file: Path) -> np.ndarray:
    """(256, 256, 3) f32, row 0 on top. Raises ValueError for another size, RuntimeError if Blender cannot read it."""
    pixels = read_pixels(file)
    height, width, _ = pixels.shape
    if (width, height) != (SPHERE, SPHERE):
        raise ValueError(f"expected a picture of {SPHERE} x {SPHERE} pixels, found {width} x {height}")
    return pixels[..., :3]


def encode_sphere(radiance: np.ndarray) -> np.ndarray:
    """The latent (9,) f32 of a sphere (256, 256, 3) f32 radiance. Raises CheckpointError, MissingPackages."""
    importing.import_packages()
    import torch
    images = torch.from_numpy(np.log10(1 + radiance.clip(0)).transpose(2, 0, 1)[None])
    with torch.inference_mode():
        return _load_autoencoder().encode(images)[0].numpy()


def decode_sphere(latent: np.ndarray) -> np.ndarray:
    """The sphere (256, 256, 3) f32 radiance of a latent (9,). Raises as `encode_sphere`."""
    importing.import_packages()
    import torch
    with torch.inference_mode():
        picture = _load_autoencoder().decode(torch.from_numpy(latent)[None])[0].numpy()
    return (10 ** picture - 1).transpose(1, 2, 0).astype(np.float32)


def require_bundled_latents(weights: Path) -> None:
    """Raises CheckpointError unless a bundle's latents are those of the bundled autoencoder."""
    from ...model.material.measured_latent import is_of_bundled_autoencoder
    from ...model.published.bundle import Bundle
    from ...model.published.bundle_files import MAPPERS, bundle_and_transformer
    if not is_of_bundled_autoencoder(Bundle(bundle_and_transformer(weights)[0]).mapper(MAPPERS[-1])):
        raise CheckpointError("these weights have latents of another autoencoder, which knows measured materials by "
                              "spheres under a light that its authors do not distribute. Load a latent (.npy) or a "
                              "picture of such a sphere instead")


def _load_autoencoder():
    """Raises CheckpointError if it was not downloaded, since a render does not need it."""
    bundle = published_weights.bundle_folder()
    if bundle is None or not (bundle / "material_autoencoder").is_dir():
        raise CheckpointError("The published weights have no folder material_autoencoder here: get it from their "
                              "repository, and put it beside diffspec_mapper")
    from ...model.published.bundle import Bundle
    return Bundle(bundle).autoencoder().eval()


register, unregister = classes(RENDERFORMER_PT_material_settings, RENDERFORMER_PT_material_latent,
                               RENDERFORMER_OT_load_latent, RENDERFORMER_OT_show_latent)
