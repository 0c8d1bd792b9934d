# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons of the settings panel."""
from __future__ import annotations

import subprocess
import tempfile

import bpy

from .. import model_cache
from . import packages


class RENDERFORMER_OT_free_model(bpy.types.Operator):
    bl_idname = "renderformer_v2.free_model"
    bl_label = "Free Model"
    bl_description = "Give the memory of the loaded network back; the next render loads it again"

    @classmethod
    def poll(cls, context):
        return model_cache.is_loaded()

    def execute(self, context):
        model_cache.free()
        return {"FINISHED"}


class RENDERFORMER_OT_install_runtime(bpy.types.Operator):
    bl_idname = "renderformer_v2.install_runtime"
    bl_label = "Install Packages"
    bl_description = ("Download the Python packages that are missing into a folder of this add-on "
                      "(PyTorch: 0.2 GB on macOS and Windows, 3 GB on Linux). Esc stops it")

    published: bpy.props.BoolProperty(name="For the Published Weights", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        if message := packages.offline():
            cls.poll_message_set(message)
            return False
        if packages.folder() is None:
            cls.poll_message_set("The add-on runs from its source folder: install the packages into this Python")
            return False
        return bool(packages.missing(packages.PACKAGES | packages.PUBLISHED))

    def invoke(self, context, event):
        wanted = packages.PUBLISHED if self.published else packages.PACKAGES
        self.commands = packages.install_commands(packages.folder(create=True), wanted)
        self.log = tempfile.TemporaryFile("w+")
        self.process = None
        self.timer = context.window_manager.event_timer_add(0.5, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            if self.process:
                self.process.kill()
            return self._end(context, "CANCELLED")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        code = self.process.poll() if self.process else 0
        if code is None:
            context.workspace.status_text_set("Installing packages... (Esc stops)")
            return {"RUNNING_MODAL"}
        if code != 0:
            self.log.seek(0)
            self.report({"ERROR"}, "pip failed:\n" + self.log.read()[-1000:])
            return self._end(context, "CANCELLED")
        if not self.commands:
            self.report({"INFO"}, "The packages are installed")
            return self._end(context, "FINISHED")
        self.process = subprocess.Popen(self.commands.pop(0), stdout=self.log, stderr=subprocess.STDOUT)
        return {"RUNNING_MODAL"}

    def _end(self, context, result: str) -> set[str]:
        context.window_manager.event_timer_remove(self.timer)
        context.workspace.status_text_set(None)
        self.log.close()
        return {result}


register, unregister = bpy.utils.register_classes_factory((RENDERFORMER_OT_free_model, RENDERFORMER_OT_install_runtime))
