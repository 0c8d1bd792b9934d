# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects that the network's pinhole camera lacks: depth of field, motion blur, transparent film behind glass."""
from __future__ import annotations

from dataclasses import dataclass, replace

import bpy

from ..convert.copying.visibility import has_holdouts, shadow_catchers
from ..convert.data.report import Report
from ..cycles.session import Look
from ..settings import Light
from . import shutter


@dataclass(frozen=True)
class Optics:
    """The number of samples that a picture is the mean of; 1 disables that kind of blur.

    With any of it Cycles sees the whole picture as it should be, and the network the samples, by a pinhole each.
    """

    lens: int = 1
    shutter: int = 1
    glass: bool = False  # the film is transparent behind glass
    holes: bool = False  # the film is opaque, but for holdouts: Cycles is asked for alpha alone
    catchers: bool = False  # some objects show nothing but the shadows on them

    @property
    def samples(self) -> int:
        """Each is at a place of its own; those of one moment follow each other."""
        return max(self.lens, self.shutter)

    def rays_of_each(self, guide_samples: int) -> int:
        """Rays of Cycles through a pixel for one of the samples; together they are as many as a sharp picture has."""
        return -(-guide_samples // self.samples)

    def rays_of_all(self, guide_samples: int) -> int:
        """Rays through a pixel of the whole picture: two samples have twice a sharp picture's, with those of each."""
        return guide_samples * (self.samples if self.samples > 2 else 1)

    @property
    def sessions(self) -> int:
        """How often Cycles runs for the picture."""
        return (self.samples if self else 0) + 1 + self.holes + 2 * self.catchers

    @property
    def scenes(self) -> int:
        """How many scenes there are to convert, that of the frame itself among them, if anything moves."""
        return self.shutter + 1 if self.shutter > 1 else 1

    def __bool__(self) -> bool:
        return self.samples > 1 or self.glass

    @classmethod
    def of(cls, depsgraph: bpy.types.Depsgraph) -> Optics:
        """What the scene wants and our settings allow."""
        wanted, scene = _wanted(depsgraph), depsgraph.scene_eval
        cycles = getattr(scene, "cycles", None)  # an add-on, which may be switched off
        return cls(scene.renderformer_v2.lens_samples if "lens" in wanted else 1,
                   scene.renderformer_v2.shutter_samples if "shutter" in wanted else 1,
                   scene.render.film_transparent and getattr(cycles, "film_transparent_glass", False),
                   not scene.render.film_transparent and has_holdouts(depsgraph), bool(shadow_catchers(depsgraph)))

    def possible(self, light: Light, depsgraph: bpy.types.Depsgraph, report: Report) -> Optics:
        """What can be had with this light; `report` says what the scene wants beyond that."""
        scene, wanted = depsgraph.scene_eval, _wanted(depsgraph)
        if "lens" in wanted and self.lens == 1:
            report.approximated(scene.camera.name, "no depth of field: raise Samples in Render Properties > "
                                                   "Depth of Field")
        if scene.camera and _is_panoramic(scene) and scene.camera.data.dof.use_dof:
            report.approximated(scene.camera.name, "no depth of field: a panoramic camera has none")
        if "shutter" in wanted and self.shutter == 1:
            report.approximated(scene.name, "no motion blur: raise Samples in Render Properties > Motion Blur")
        for still in (obj for obj in depsgraph.objects if self.shutter > 1 and not obj.cycles.use_motion_blur):
            report.approximated(still.name, "its Motion Blur is off, but it is blurred")
        if self.shutter > 1 and scene.cycles.rolling_shutter_type != "NONE":
            report.approximated(scene.name, "Rolling Shutter is ignored")
        allowed = self
        for catcher in shadow_catchers(depsgraph):
            report.approximated(catcher.name, "a shadow catcher catches only shadows of direct light"
                                if light is Light.TRACED else
                                "a shadow catcher is shown like any object: its shadows need Light > With Cycles")
            allowed = replace(allowed, catchers=light is Light.TRACED)
        if self.glass and light is not Light.TRACED:
            report.approximated(scene.name, "the film is opaque behind glass: Transparent Glass needs Light > With "
                                            "Cycles")
            return replace(allowed, glass=False)
        return allowed

    def look(self) -> Look:
        """How Cycles sees all samples at once."""
        return Look(lens=self.lens > 1, shutter=self.shutter > 1, glass=self.glass)

    def frames(self, depsgraph: bpy.types.Depsgraph) -> list[float]:
        """When each sample is seen, in the order of time."""
        if self.shutter == 1:
            return [depsgraph.scene_eval.frame_current_final] * self.samples
        moments = shutter.moments(depsgraph.scene_eval, self.shutter).tolist()
        return [moments[i * self.shutter // self.samples] for i in range(self.samples)]


def _is_panoramic(scene: bpy.types.Scene) -> bool:
    return scene.camera.type == "CAMERA" and scene.camera.data.type == "PANO"


def _wanted(depsgraph: bpy.types.Depsgraph) -> set[str]:
    """What the scene and its view layer ask for: {"lens", "shutter"}."""
    scene, wanted = depsgraph.scene_eval, set()
    if scene.camera and scene.camera.type == "CAMERA" and scene.camera.data.dof.use_dof and not _is_panoramic(scene):
        wanted.add("lens")
    if scene.render.use_motion_blur and depsgraph.view_layer_eval.use_motion_blur:
        wanted.add("shutter")
    return wanted
