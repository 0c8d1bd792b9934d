# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects that the network's pinhole camera lacks: depth of field, motion blur, transparent film behind glass."""
from __future__ import annotations

from dataclasses import dataclass, replace

import bpy

from ..convert.copying.visibility import has_holdouts, shadow_catchers
from ..convert.data.report import Report
from ..cycles.session_options import CameraModel
from ..frame_settings import Light
from ..sampling import Sampling
from . import shutter


@dataclass(frozen=True)
class Optics:
    """The number of samples that a picture is the mean of; 1 disables that kind of blur.

    True if there is any blur or transparent glass: Cycles then renders the whole picture with it, and the network each
    sample with a pinhole.
    """

    lens_samples: int = 1
    shutter_samples: int = 1
    transparent_glass: bool = False  # the film is transparent behind glass
    holdouts: bool = False           # the film is opaque but for holdouts: one more session of Cycles finds its alpha
    shadow_catchers: bool = False    # some objects show nothing but the shadows on them

    @property
    def samples(self) -> int:
        """Each has its own position on the lens; those of one moment follow each other."""
        return max(self.lens_samples, self.shutter_samples)

    def rays_of_sample(self, sampling: Sampling) -> Sampling:
        """Cycles' rays through a pixel for one of the samples; together they are as many as a sharp picture has."""
        return sampling.divided(self.samples)

    def rays_of_picture(self, sampling: Sampling) -> Sampling:
        """Rays through a pixel of the whole picture: two samples have twice a sharp picture's, with those of each.

        What is subtracted from another picture has the same rays in every pixel as that.
        """
        rays = sampling.times(self.samples if self.samples > 2 else 1)
        return rays.fixed if self.holdouts or self.shadow_catchers else rays

    @property
    def sessions(self) -> int:
        """How often Cycles runs for the picture."""
        return (self.samples if self else 0) + 1 + self.holdouts + 2 * self.shadow_catchers

    @property
    def scenes(self) -> int:
        """How many scenes there are to convert, that of the frame itself among them, if anything moves."""
        return self.shutter_samples + 1 if self.shutter_samples > 1 else 1

    def __bool__(self) -> bool:
        return self.samples > 1 or self.transparent_glass

    @classmethod
    def read(cls, depsgraph: bpy.types.Depsgraph) -> Optics:
        """What the scene has and our settings allow."""
        scene = depsgraph.scene_eval
        cycles = getattr(scene, "cycles", None)  # an add-on, which may be switched off
        return replace(
            cls.of_blur(scene, depsgraph.view_layer_eval),
            transparent_glass=scene.render.film_transparent and getattr(cycles, "film_transparent_glass", False),
            holdouts=not scene.render.film_transparent and has_holdouts(depsgraph),
            shadow_catchers=bool(shadow_catchers(depsgraph)))

    @classmethod
    def of_blur(cls, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Optics:
        """The blur alone, which the settings tell without the objects."""
        effects, ours = _effects(scene, layer), scene.renderformer_v2
        return cls(ours.lens_samples if "lens" in effects else 1, ours.shutter_samples if "shutter" in effects else 1)

    def possible(self, light: Light, depsgraph: bpy.types.Depsgraph, report: Report) -> Optics:
        """What of it is possible with this light; reports what the scene has beyond that."""
        scene = depsgraph.scene_eval
        effects = _effects(scene, depsgraph.view_layer_eval)
        if "lens" in effects and self.lens_samples == 1:
            report.approximated(scene.camera.name, "no depth of field: raise Samples in Render Properties > "
                                                   "Depth of Field")
        if scene.camera and _is_panoramic(scene) and scene.camera.data.dof.use_dof:
            report.approximated(scene.camera.name, "no depth of field: a panoramic camera has none")
        if "shutter" in effects and self.shutter_samples == 1:
            report.approximated(scene.name, "no motion blur: raise Samples in Render Properties > Motion Blur")
        has_blur = self.shutter_samples > 1
        for still in (obj for obj in depsgraph.objects if has_blur and not obj.cycles.use_motion_blur):
            report.approximated(still.name, "its Motion Blur is off, but it is blurred")
        if has_blur and scene.cycles.rolling_shutter_type != "NONE":
            report.approximated(scene.name, "Rolling Shutter is ignored")
        possible = self
        for catcher in shadow_catchers(depsgraph):
            report.approximated(catcher.name, "a shadow catcher catches only shadows of direct light"
                                if light is Light.TRACED else
                                "a shadow catcher is shown like any object: its shadows need Light > With Cycles")
            possible = replace(possible, shadow_catchers=light is Light.TRACED)
        if self.transparent_glass and light is not Light.TRACED:
            report.approximated(scene.name, "the film is opaque behind glass: Transparent Glass needs Light > With "
                                            "Cycles")
            return replace(possible, transparent_glass=False)
        return possible

    def camera_model(self) -> CameraModel:
        """The camera with which Cycles renders all samples at once."""
        return CameraModel(depth_of_field=self.lens_samples > 1, motion_blur=self.shutter_samples > 1,
                           transparent_glass=self.transparent_glass)

    def frames(self, depsgraph: bpy.types.Depsgraph) -> list[float]:
        """The moment of each sample, in the order of time."""
        if self.shutter_samples == 1:
            return [depsgraph.scene_eval.frame_float] * self.samples
        moments = shutter.moments(depsgraph.scene_eval, self.shutter_samples).tolist()
        return [moments[i * self.shutter_samples // self.samples] for i in range(self.samples)]


def _is_panoramic(scene: bpy.types.Scene) -> bool:
    return scene.camera.type == "CAMERA" and scene.camera.data.type == "PANO"


def _effects(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> set[str]:
    """What the scene and its view layer switch on: {"lens", "shutter"}."""
    effects = set()
    if scene.camera and scene.camera.type == "CAMERA" and scene.camera.data.dof.use_dof and not _is_panoramic(scene):
        effects.add("lens")
    if scene.render.use_motion_blur and layer.use_motion_blur:
        effects.add("shutter")
    return effects
