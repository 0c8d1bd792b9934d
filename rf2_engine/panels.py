# SPDX-License-Identifier: GPL-3.0-or-later
"""Our panels, and Blender's ordinary panels shown for this engine too."""
from __future__ import annotations

import bpy

from . import model_cache, statistics
from .engine import RenderFormerEngine
from .setup import package_panel, packages, published_weights

# Panels that Blender shows for any engine but that do nothing here, or that a more complete Eevee panel replaces.
EXCLUDED = {
    "DATA_PT_light", "NODE_DATA_PT_light", "DATA_PT_falloff_curve",
}
EEVEE_PANELS = {
    "MATERIAL_PT_preview", "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume", "EEVEE_MATERIAL_PT_displacement", "EEVEE_WORLD_PT_surface",
    "EEVEE_WORLD_PT_volume", "EEVEE_WORLD_PT_mist", "DATA_PT_EEVEE_light",
    "NODE_DATA_PT_EEVEE_light", "DATA_PT_spot", "VIEWLAYER_PT_filter",
}
EEVEE_ENGINES = {"BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"}  # the first from 5.0 on, the second up to 4.5


class _Panel(bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context):
        return context.engine == RenderFormerEngine.bl_idname


class RENDERFORMER_PT_settings(_Panel):
    bl_label = "RenderFormer-V2"
    bl_context = "render"
    bl_order = 0

    def draw(self, context):
        layout, settings = self.layout, context.scene.renderformer_v2
        layout.use_property_split, layout.use_property_decorate = True, False
        package_panel.draw_packages(layout, packages.PACKAGES)
        column = layout.column()
        column.prop(settings, "weights_source")
        if settings.weights_source == "FOLDER":
            column.prop(settings, "weights_folder")
        elif settings.weights_source == "PUBLISHED":
            _draw_published(layout)
        column.prop(settings, "device")
        column.prop(settings, "precision")
        column.prop(settings, "threads_mode")
        threads = column.row()
        threads.active = settings.threads_mode == "FIXED"
        threads.prop(settings, "threads")
        column = layout.column()
        column.prop(settings, "token_budget")
        column.prop(settings, "max_edge")
        column.prop(settings, "light")
        column.prop(settings, "guide_samples")
        layout.prop(context.scene.render, "film_transparent", text="Transparent Film")
        if model_cache.is_loaded():
            layout.operator("renderformer_v2.free_model")


def _draw_published(layout) -> None:
    bundle = published_weights.bundle_folder()
    if bundle is None or published_weights.missing_parts(bundle) or packages.missing(packages.PUBLISHED):
        column = layout.column()
        column.label(text="The published weights or their packages are not complete", icon="ERROR")
        column.operator("preferences.addon_show", text="Open Preferences").module = packages.EXTENSION


class RENDERFORMER_PT_report(_Panel):
    bl_label = "Last Render"
    bl_context = "render"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_order = 1  # below the panels of other modules
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        column = self.layout.column(align=True)
        if not statistics.last_frame:
            column.label(text="Nothing was rendered to the end")
        for i, layer in enumerate(statistics.last_frame):
            if len(statistics.last_frame) > 1:
                if i:
                    column.separator()
                column.label(text=layer.layer, icon="RENDERLAYERS")
            _draw_statistics(column, layer)


def _draw_statistics(column, layer: statistics.LayerStatistics) -> None:
    if layer.error:
        column.label(text=layer.error, icon="ERROR")
        return
    column.label(text=f"{layer.triangles} triangles, {layer.tokens} tokens")
    for stage, seconds in layer.seconds.items():
        column.label(text=f"{stage}: {seconds:.2f} s")
    for line in layer.report:
        column.label(text=line, icon="INFO")


def adopted_panels():
    """Blender's panels that make sense for this engine, built-in ones and those of other add-ons."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        if panel.__name__ in EEVEE_PANELS and EEVEE_ENGINES.intersection(engines):
            yield panel
        elif "BLENDER_RENDER" in engines and panel.__name__ not in EXCLUDED:
            yield panel


_register, _unregister = bpy.utils.register_classes_factory(
    (RENDERFORMER_PT_settings, RENDERFORMER_PT_report))


def register() -> None:
    _register()
    for panel in adopted_panels():
        panel.COMPAT_ENGINES.add(RenderFormerEngine.bl_idname)


def unregister() -> None:
    for panel in adopted_panels():
        panel.COMPAT_ENGINES.discard(RenderFormerEngine.bl_idname)
    _unregister()
