# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare in the sidebar of the Image Editor, and in its header."""
from __future__ import annotations

import bpy

from ..registering import appended, classes, pairs
from ..runtime.running import ENGINE
from ..setup.display import draw_text
from .events import TAB
from .state import comparison


class RENDERFORMER_PT_compare(bpy.types.Panel):
    bl_label = "Compare"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = TAB

    @classmethod
    def poll(cls, context):
        return _is_image_editor(context)

    def draw_header(self, context):
        self.layout.prop(comparison.settings, "show", text="")

    def draw(self, context):
        layout, settings = self.layout, comparison.settings
        layout.use_property_split, layout.use_property_decorate = True, False
        for name, side in (("A", settings.a), ("B", settings.b)):
            _draw_side(layout.column(heading=name), side)
        row = layout.row()
        row.operator("renderformer_v2.compare_swap", text="Swap", icon="ARROW_LEFTRIGHT")
        row.operator("renderformer_v2.compare_refresh", icon="FILE_REFRESH")
        layout.prop(settings, "mode")
        extra = {"SPLIT": "split", "BLINK": "interval", "DIFFERENCE": "gain"}.get(settings.mode)
        if extra:
            layout.prop(settings, extra)
        if settings.show and comparison.message:
            draw_text(layout, comparison.message)
            if comparison.has_one_picture:
                _draw_way_out(layout, context)


def _draw_way_out(layout, context) -> None:
    """What makes a second picture."""
    if context.scene.render.engine == ENGINE:
        layout.operator("renderformer_v2.render_reference", icon="RENDER_STILL")


def _draw_side(column, side) -> None:
    column.prop(side, "kind", text="")
    if side.kind == "IMAGE":
        column.prop_search(side, "image", bpy.data, "images", text="")
    elif side.kind == "SLOT":
        column.prop(side, "slot")
    column.prop(side, "pass_name", placeholder="Same as Header")
    column.prop(side, "layer", placeholder="Same as Header")


class RENDERFORMER_PT_compare_metrics(bpy.types.Panel):
    bl_label = "Metrics"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_parent_id = "RENDERFORMER_PT_compare"

    @classmethod
    def poll(cls, context):
        return comparison.settings.show and comparison.a is not None

    def draw(self, context):
        layout, measurement = self.layout, comparison.measurement
        layout.prop(comparison.settings, "region", text="")
        if measurement is None:
            return
        if measurement.closeness:
            _draw_closeness(layout.column(align=True), measurement.closeness)
            for note in measurement.notes:
                draw_text(layout, note, icon="INFO")
        elif measurement.error:
            draw_text(layout, measurement.error)
        else:
            row = layout.row()
            row.progress(factor=measurement.fraction, text="Measuring")
            row.operator("renderformer_v2.compare_cancel", text="", icon="X")
        row = layout.row()
        row.active = measurement.closeness is not None
        row.operator("renderformer_v2.compare_export", icon="EXPORT")


def _draw_closeness(column, closeness) -> None:
    rows = [("PSNR", f"{closeness.psnr:.2f} dB"), ("SSIM", f"{closeness.ssim:.4f}"), ("FLIP", f"{closeness.flip:.4f}"),
            ("HDR-FLIP", f"{closeness.hdr_flip:.4f}")]
    if closeness.lpips is not None:
        rows.append(("LPIPS", f"{closeness.lpips:.4f}"))
    rows += [("Render Time A", _seconds(comparison.a)), ("Render Time B", _seconds(comparison.b))]
    for name, value in rows:
        row = column.row()
        row.label(text=name)
        row.label(text=value)


def _seconds(picture) -> str:
    seconds = picture.credits.seconds
    return "not known" if seconds is None else f"{seconds:.2f} s"


class RENDERFORMER_MT_compare(bpy.types.Menu):
    bl_label = "Compare"

    def draw(self, context):
        layout, settings = self.layout, comparison.settings
        layout.prop(settings, "show")
        layout.separator()
        for item in settings.bl_rna.properties["mode"].enum_items:
            layout.operator("renderformer_v2.compare", text=item.name).mode = item.identifier
        layout.separator()
        layout.operator("renderformer_v2.compare_refresh")
        layout.operator("renderformer_v2.compare_export")


def _is_image_editor(context) -> bool:
    return context.area.ui_type == "IMAGE_EDITOR"  # and no UV Editor, which is the same kind of space


def _menu(self, context):
    if _is_image_editor(context):
        self.layout.menu("RENDERFORMER_MT_compare")


def _button(self, context):
    if _is_image_editor(context):
        show = comparison.settings.show
        self.layout.operator("renderformer_v2.compare", icon="MOD_MIRROR", depress=show)
        if show and comparison.has_one_picture:
            _draw_way_out(self.layout, context)
            self.layout.operator("renderformer_v2.compare_choose", icon="RIGHTARROW")


register, unregister = pairs(
    classes(RENDERFORMER_PT_compare, RENDERFORMER_PT_compare_metrics, RENDERFORMER_MT_compare),
    appended("IMAGE_MT_editor_menus", _menu), appended("IMAGE_HT_header", _button))
