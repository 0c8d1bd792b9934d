# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that install, repair and stop installing Python packages."""
from __future__ import annotations

import bpy

from ..registering import classes
from ..setup import package_install, packages, redraw, shared_folders, wheels
from ..setup.display import amount, draw_text, free_space
from . import package_panel


class _Install:
    """Asks first; then a process works while Blender goes on. wanted() gives the wheels, or raises wheels.NoWheel."""

    by_content = False

    @classmethod
    def poll(cls, context):
        if message := packages.refusal():
            cls.poll_message_set(message)
        return not message

    def invoke(self, context, event):
        if problem := self.problem():
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        return context.window_manager.invoke_props_dialog(self, width=460, confirm_text=self.bl_label)

    def draw(self, context):
        package_panel.draw_build(self.layout)
        if problem := self.problem():
            draw_text(self.layout, problem)
        else:
            package_panel.draw_confirmation(self.layout, self.wanted(), self.by_content)

    def execute(self, context):
        if problem := self.problem():
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        kept = packages.preferences()
        torch_index = kept.torch_cpu_index if packages.build() == "CPU" else kept.torch_cuda_index
        installation = package_install.begin(packages.folder(create=True), self.wanted(), by_content=self.by_content,
                                             index=kept.package_index, torch_index=torch_index)
        if not bpy.app.background:
            redraw.keep_redrawing()
            return {"FINISHED"}
        installation.wait()  # a script's call returns when all is there
        packages.look_again()
        if installation.state == "failed":
            self.report({"ERROR"}, installation.error)
            return {"CANCELLED"}
        return {"FINISHED"}

    def problem(self) -> str:
        """Why these packages cannot be installed, or ""."""
        try:
            needed = 0 if self.by_content else wheels.space_needed(self.wanted())
        except wheels.NoWheel as error:
            return str(error)
        target = packages.folder()
        free = free_space(target)
        return "" if free >= needed else (f"The disk of {target} has too little space: {amount(needed)} are needed, "
                                          f"{amount(free)} are free")


class RENDERFORMER_OT_install_packages(_Install, bpy.types.Operator):
    bl_idname = "renderformer_v2.install_packages"
    bl_label = "Install Packages"
    bl_description = ("Download the Python packages that are missing into a folder of this add-on. You see the size "
                      "before anything is downloaded")

    published: bpy.props.BoolProperty(name="For the Published Weights", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(packages.missing(packages.PACKAGES | packages.PUBLISHED)
                                              or packages.other_build())

    def wanted(self):
        group = packages.PUBLISHED if self.published else packages.PACKAGES
        return packages.lacking(packages.missing(group) or group)


class RENDERFORMER_OT_repair_packages(_Install, bpy.types.Operator):
    bl_idname = "renderformer_v2.repair_packages"
    bl_label = "Repair Packages"
    bl_description = "Check every installed file, and download packages again if files are damaged or missing"
    by_content = True

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(packages.installed())

    def wanted(self):
        return packages.wanted(packages.installed())


class RENDERFORMER_OT_cancel_packages(bpy.types.Operator):
    bl_idname = "renderformer_v2.cancel_packages"
    bl_label = "Cancel"
    bl_description = "Stop installing. Packages that are already complete are kept"

    @classmethod
    def poll(cls, context):
        return package_install.is_running()

    def execute(self, context):
        package_install.current.cancel()
        return {"FINISHED"}


_register, _unregister = classes(
    RENDERFORMER_OT_install_packages, RENDERFORMER_OT_repair_packages, RENDERFORMER_OT_cancel_packages)


def register() -> None:
    _register()
    if not shared_folders.named(shared_folders.PACKAGES):  # another machine may be at work there
        package_install.tidy_up(packages.folder())


def unregister() -> None:
    package_install.forget()
    redraw.unregister()
    _unregister()
