# SPDX-License-Identifier: GPL-3.0-or-later
"""Render Properties: the engine's settings, sampling, film, blur, performance, viewport."""
from __future__ import annotations

from pathlib import Path

from ...model.errors import CheckpointError
from ...model.published.bundle_files import check_weights
from ..frame.optics import Optics
from ..frame_settings import is_published, read_sampling, traces_light
from ..preferences import package_panel
from ..registering import classes
from ..runtime import device, model_cache
from ..setup import extension, packages, published_weights
from ..setup.display import draw_text
from . import light_paths
from .panel import EnginePanel
from .presets import RENDERFORMER_PT_presets


class RENDERFORMER_PT_settings(EnginePanel):
    bl_label = "RenderFormer-V2"
    bl_context = "render"

    def draw_header_preset(self, context):
        RENDERFORMER_PT_presets.draw_panel_header(self.layout)

    def draw(self, context):
        layout, settings = self.split_layout(), context.scene.renderformer_v2
        package_panel.draw_packages(layout, packages.PACKAGES)
        column = layout.column()
        column.prop(settings, "weights_source")
        if settings.weights_source == "FOLDER":
            column.prop(settings, "weights_folder")
            if problem := _find_folder_problem(settings):
                draw_text(column, problem)
        elif settings.weights_source == "PUBLISHED":
            _draw_published(column)
        published = is_published(settings)
        if published:
            column.prop(settings, "transformer")
        column.prop(settings, "device")
        if settings.device == "cuda":
            column.prop(settings, "card")
        if problem := device.find_problem(settings.chosen_device()):
            draw_text(column, problem)
        column.prop(settings, "precision")
        if not published:  # published networks take no traced light
            column.prop(settings, "light")
        numbers = layout.column()
        numbers.prop(settings, "token_budget")
        numbers.prop(settings, "max_edge")
        numbers.prop(settings, "as_is")
        if published:
            numbers.prop(settings, "paper_lamps")
            numbers.operator("renderformer_v2.suggested_budget")
        numbers.prop(settings, "bake_unknown")


def _find_folder_problem(settings) -> str:
    """Why a render will refuse the chosen folder, as far as a quick look tells; or ""."""
    try:
        check_weights(Path(settings.weights()))
    except CheckpointError as error:
        return str(error)
    return ""


def _draw_published(layout) -> None:
    bundle = published_weights.bundle_folder()
    if bundle is None or published_weights.missing_parts(bundle) or packages.missing(packages.PUBLISHED):
        column = layout.column()
        draw_text(column, "The published weights, or the packages for them, are incomplete")
        column.operator("preferences.addon_show", text="Open Preferences").module = extension.EXTENSION


class RENDERFORMER_PT_sampling(EnginePanel):
    """As Cycles has it, and in the same place."""

    bl_label = "Sampling"
    bl_context = "render"

    def draw(self, context):
        layout, settings = self.split_layout(), context.scene.renderformer_v2
        row = layout.column(align=True, heading="Noise Threshold").row(align=True)
        row.active = acts = _noise_threshold_acts(context)
        row.prop(settings, "use_adaptive_sampling", text="")
        threshold = row.row()
        threshold.active = settings.use_adaptive_sampling
        threshold.prop(settings, "adaptive_threshold", text="")
        column = layout.column(align=True)
        column.prop(settings, "guide_samples")
        least = column.column()
        least.active = acts and settings.use_adaptive_sampling
        least.prop(settings, "adaptive_min_samples")


def _noise_threshold_acts(context) -> bool:
    """Whether a picture has enough samples for Cycles to look at its noise, and traced light to see it in."""
    scene, layer = context.scene, context.view_layer
    sampling = read_sampling(scene, layer)._replace(threshold=1.0)
    return traces_light(scene.renderformer_v2) and Optics.of_blur(scene, layer).rays_of_picture(sampling).is_adaptive


class RENDERFORMER_PT_film(EnginePanel):
    bl_label = "Film"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, scene = self.split_layout(), context.scene
        layout.prop(scene.cycles, "film_exposure")
        layout.prop(scene.render, "film_transparent", text="Transparent")
        is_traced = traces_light(scene.renderformer_v2)
        glass = layout.column()
        glass.active = scene.render.film_transparent and is_traced
        glass.prop(scene.cycles, "film_transparent_glass", text="Transparent Glass")
        glass.prop(scene.cycles, "film_transparent_roughness", text="Roughness")
        if scene.render.film_transparent and not is_traced:
            draw_text(layout, "Transparent Glass needs the bundled network, and Light: With Cycles", icon="INFO")
        column = layout.column()
        column.prop(scene.cycles, "pixel_filter_type", text="Pixel Filter")
        if scene.cycles.pixel_filter_type != "BOX":
            column.prop(scene.cycles, "filter_width", text="Width")


class RENDERFORMER_PT_performance(EnginePanel):
    bl_label = "Performance"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.split_layout(), context.scene.renderformer_v2
        layout.prop(settings, "threads_mode")
        threads, is_fixed = layout.column(), settings.threads_mode == "FIXED"
        threads.enabled = is_fixed
        threads.prop(settings if is_fixed else context.scene.render, "threads")  # Blender's says how many it takes
        layout.prop(context.scene.render, "use_persistent_data", text="Persistent Data")
        if model_cache.is_loaded():
            layout.operator("renderformer_v2.free_model")


class RENDERFORMER_PT_depth_of_field(EnginePanel):
    bl_label = "Depth of Field"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, camera = self.split_layout(), context.scene.camera
        layout.prop(context.scene.renderformer_v2, "lens_samples", text="Samples")
        if camera and camera.type == "CAMERA" and not camera.data.dof.use_dof:
            draw_text(layout, f"Depth of Field of the camera {camera.name} is off", icon="INFO")


class RENDERFORMER_PT_motion_blur(EnginePanel):
    bl_label = "Motion Blur"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.prop(context.scene.render, "use_motion_blur", text="")

    def draw(self, context):
        layout, settings, render = self.split_layout(), context.scene.renderformer_v2, context.scene.render
        layout.active = render.use_motion_blur
        layout.prop(settings, "shutter_samples", text="Samples")
        if render.use_motion_blur and settings.shutter_samples == 1:
            draw_text(layout, "No motion blur: set Samples above 1", icon="INFO")
        layout.prop(render, "motion_blur_position", text="Position")
        layout.prop(render, "motion_blur_shutter")


class RENDERFORMER_PT_viewport(EnginePanel):
    bl_label = "Viewport"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, viewport = self.split_layout(), context.scene.renderformer_v2.viewport
        layout.prop(viewport, "token_budget")
        layout.prop(viewport, "resolution")
        layout.prop(context.scene.render, "preview_pixel_size", text="Pixel Size")
        layout.prop(viewport, "time_limit")


register, unregister = classes(
    RENDERFORMER_PT_settings, RENDERFORMER_PT_sampling, light_paths.RENDERFORMER_PT_light_paths, RENDERFORMER_PT_film,
    RENDERFORMER_PT_depth_of_field, RENDERFORMER_PT_motion_blur, RENDERFORMER_PT_performance, RENDERFORMER_PT_viewport)
