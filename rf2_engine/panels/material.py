# SPDX-License-Identifier: GPL-3.0-or-later
"""Material Properties: settings, and the appearance latent, nine numbers in place of the nodes (published weights)."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...model.errors import CheckpointError
from ..material_settings import read_latent, set_latent
from ..registering import classes
from ..settings import is_published
from ..setup import importing, published_weights
from ..setup.display import draw_text
from ..setup.packages import MissingPackages
from .panel import EnginePanel

SPHERE = 256  # pixels, width and height of the pictures of spheres
PICTURE = "Latent of {}"


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
        """For published weights, and for materials that have a latent already."""
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
    bl_description = ("From a .npy file of nine numbers; or from a picture of a sphere of the material, 256 x 256 "
                      "linear radiance as the authors' material pictures show it, by the published autoencoder")
    bl_options = {"UNDO"}

    filter_glob: StringProperty(default="*.npy;*.exr;*.hdr", options={"HIDDEN"})

    def execute(self, context):
        file = Path(self.filepath)
        try:
            numbers = read_latent(file) if file.suffix.lower() == ".npy" else encode_sphere(read_radiance(file))
            set_latent(context.material, numbers)
        except (ValueError, OSError, RuntimeError, CheckpointError, MissingPackages) as error:
            self.report({"ERROR"}, f"{file.name}: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}


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
    image = bpy.data.images.load(str(file))
    try:
        width, height = image.size
        if (width, height) != (SPHERE, SPHERE):
            raise ValueError(f"expected a picture of {SPHERE} x {SPHERE} pixels, found {width} x {height}")
        pixels = np.empty((height, width, 4), np.float32)
        image.pixels.foreach_get(pixels.ravel())
    finally:
        bpy.data.images.remove(image)
    return pixels[::-1, :, :3]


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
