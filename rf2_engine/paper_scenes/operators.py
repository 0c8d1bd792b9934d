# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import and Export > RenderFormer Scene."""
from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ...model.errors import CheckpointError, SceneError
from ..convert.data.report import Report, grouped
from ..registering import appended, classes, pairs
from ..setup.packages import MissingPackages

LABEL = "RenderFormer Scene (.json, .h5)"


class RENDERFORMER_OT_import_scene(bpy.types.Operator, ImportHelper):
    bl_idname = "import_scene.renderformer_v2"
    bl_label = "Import RenderFormer Scene"
    bl_description = ("Make a new scene from a prepared frame of the authors' code (the scene_config.json in its "
                      "folder), from an H5 scene, or from the JSON file of a scene of the first RenderFormer")
    bl_options = {"UNDO"}

    filter_glob: StringProperty(default="*.json;*.h5;*.hdf5", options={"HIDDEN"})
    resolution: IntProperty(name="Resolution", default=512, min=64, soft_max=2048,
                            description="Width and height of the picture in pixels. The paper's pictures have 512 or "
                                        "2048")

    def execute(self, context):
        from .scene_import import import_scene
        report = Report()
        try:
            scene = import_scene(Path(self.filepath), report, self.resolution)
        except (SceneError, OSError) as error:
            self.report({"ERROR"}, explain(error, "read"))
            return {"CANCELLED"}
        if context.window is not None:
            context.window.scene = scene
        show_report(self, report)
        return {"FINISHED"}


class RENDERFORMER_OT_export_scene(bpy.types.Operator, ExportHelper):
    bl_idname = "export_scene.renderformer_v2"
    bl_label = "Export RenderFormer Scene"
    bl_description = ("Write the scene for the authors' code, as F12 shows it: a folder with scene_config.json, or "
                      "with the ending .h5 an H5 scene with the latents of the published weights. The picture in the "
                      "active render slot is cleared")

    filename_ext = ""
    filter_glob: StringProperty(default="*.h5;*.json", options={"HIDDEN"})

    def execute(self, context):
        from . import frame_export, h5_scene
        from .scene_import import H5
        report, target = Report(), Path(self.filepath)
        if target.suffix.lower() == ".json":  # the folder will contain it
            target = target.with_suffix("")
        try:
            if target.suffix.lower() in H5:
                h5_scene.export_h5(context.scene, context.scene.renderformer_v2.weights(), target, report)
            else:
                frame_export.export_frame(context.scene, target, report)
        except (SceneError, CheckpointError, MissingPackages, OSError) as error:
            self.report({"ERROR"}, explain(error, "written"))
            return {"CANCELLED"}
        show_report(self, report)
        return {"FINISHED"}

    def invoke(self, context, event):
        self.filepath = bpy.path.clean_name(context.scene.name) + "_frame"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


def explain(error: Exception, action: str) -> str:
    """The error for users; action: what could not be done with the file, such as "read"."""
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename} cannot be {action}: {error.strerror}"
    return str(error)


def show_report(operator: bpy.types.Operator, report: Report) -> None:
    for group in grouped(report.entries):
        operator.report({"WARNING"}, str(group))


def _draw_import(menu, context) -> None:
    menu.layout.operator(RENDERFORMER_OT_import_scene.bl_idname, text=LABEL)


def _draw_export(menu, context) -> None:
    menu.layout.operator(RENDERFORMER_OT_export_scene.bl_idname, text=LABEL)


register, unregister = pairs(classes(RENDERFORMER_OT_import_scene, RENDERFORMER_OT_export_scene),
                             appended("TOPBAR_MT_file_import", _draw_import),
                             appended("TOPBAR_MT_file_export", _draw_export))
