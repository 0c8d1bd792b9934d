# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that install, repair and stop installing Python packages."""
from __future__ import annotations

import bpy

from ..registering import classes
from ..setup import display, extension, package_install, packages, wheels
from ..setup.display import draw_text, format_size, free_space
from . import package_panel


class _Install:
    """Asks first; then a process installs required_wheels(), which raises wheels.NoWheel, while Blender goes on."""

    by_content = False
    offers_builds = False  # decided before the dialog: its own choice of a build may leave nothing to download

    @classmethod
    def poll(cls, context):
        if message := packages.refusal():
            cls.poll_message_set(message)
        return not message

    def invoke(self, context, event):
        if problem := self.problem():
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        self.offers_builds = any(wheel.name == "torch" for wheel in self.required_wheels())
        return context.window_manager.invoke_props_dialog(self, width=460, confirm_text=self.bl_label)

    def draw(self, context):
        if self.offers_builds:
            package_panel.draw_build(self.layout)
        if problem := self.problem():
            draw_text(self.layout, problem)
        else:
            package_panel.draw_confirmation(self.layout, self.required_wheels(), self.by_content)

    def execute(self, context):
        if problem := self.problem():
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        preferences = extension.preferences()
        torch_index = preferences.torch_cpu_index if packages.build() == "CPU" else preferences.torch_cuda_index
        installation = package_install.current.begin(
            packages.folder(create=True), self.required_wheels(), by_content=self.by_content,
            index=preferences.package_index, torch_index=torch_index)
        if not bpy.app.background:
            display.keep_redrawing()
            return {"FINISHED"}
        installation.wait()  # for a script the operator returns when all is done
        packages.refresh()
        if installation.state == "failed":
            self.report({"ERROR"}, installation.error)
            return {"CANCELLED"}
        return {"FINISHED"}

    def problem(self) -> str:
        """Why these packages cannot be installed, or ""."""
        try:
            needed = 0 if self.by_content else wheels.space_needed(self.required_wheels())
        except wheels.NoWheel as error:
            return str(error)
        target = packages.folder()
        free = free_space(target)
        if free >= needed:
            return ""
        return (f"The disk of {target} has too little space: {format_size(needed)} are needed, {format_size(free)} are "
                "free")


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

    def required_wheels(self):
        group = packages.PUBLISHED if self.published else packages.PACKAGES
        return packages.missing_wheels(packages.missing(group) or group)


class RENDERFORMER_OT_repair_packages(_Install, bpy.types.Operator):
    bl_idname = "renderformer_v2.repair_packages"
    bl_label = "Repair Packages"
    bl_description = "Check every installed file, and download packages again if files are damaged or missing"
    by_content = True

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(packages.installed())

    def required_wheels(self):
        return packages.required_wheels(packages.installed())


class RENDERFORMER_OT_cancel_packages(bpy.types.Operator):
    bl_idname = "renderformer_v2.cancel_packages"
    bl_label = "Cancel"
    bl_description = "Stop installing. Packages that are already complete are kept"

    @classmethod
    def poll(cls, context):
        return package_install.current.is_running

    def execute(self, context):
        package_install.current.process.cancel()
        return {"FINISHED"}


_register, _unregister = classes(
    RENDERFORMER_OT_install_packages, RENDERFORMER_OT_repair_packages, RENDERFORMER_OT_cancel_packages)


def register() -> None:
    _register()
    if not extension.shared_folder(packages.PACKAGES_VARIABLE):  # another machine may be at work there
        package_install.tidy_up(packages.folder())


def unregister() -> None:
    package_install.current.forget()
    display.unregister()
    _unregister()
