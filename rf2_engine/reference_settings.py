# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the Cycles reference: `scene.renderformer_v2.reference`."""
from __future__ import annotations

from dataclasses import dataclass

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from .passes import update_sockets
from .registering import classes

# As the training pictures of the published weights were rendered (docs/scene-input.md 10).
PAPER_SAMPLES = 4096
PAPER = {"max_bounces": 12, "diffuse_bounces": 4, "glossy_bounces": 4, "transmission_bounces": 12, "volume_bounces": 0,
         "transparent_max_bounces": 8, "sample_clamp_direct": 0.0, "sample_clamp_indirect": 10.0,
         "caustics_reflective": True, "caustics_refractive": True, "blur_glossy": 1.0, "use_adaptive_sampling": True,
         "adaptive_threshold": 0.01, "adaptive_min_samples": 0, "use_guiding": False, "use_light_tree": True}
BOUNCES = ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces")


class ReferenceSettings(bpy.types.PropertyGroup):
    # What decides about passes cannot be keyframed: sockets and files have the same in every frame.
    use: BoolProperty(
        name="Cycles Reference", options=set(), update=update_sockets,
        description="After each picture, Cycles renders the same view layer into the pass Cycles Reference. Our "
                    "picture is on screen first, and stays if the reference is stopped with Esc",
    )
    samples: IntProperty(name="Samples", default=128, min=1, soft_max=4096, max=1 << 24,
                         description="Samples per pixel of the reference")
    use_scene_samples: BoolProperty(
        name="As in Cycles", description="As many samples as the scene's Cycles settings have")
    time_limit: FloatProperty(name="Time Limit", default=0.0, min=0.0, step=100, subtype="TIME", unit="TIME_ABSOLUTE",
                              description="Stop the reference after this time and keep the samples rendered so far. 0 "
                                          "is no limit")
    use_denoising: BoolProperty(name="Denoise", default=True, description="Denoise the reference")
    denoiser: EnumProperty(
        name="Denoiser", items=(("SCENE", "As in Cycles", "The denoiser of the scene's Cycles settings"),
                                ("OPENIMAGEDENOISE", "OpenImageDenoise", "Intel's, on the processor or a GPU")))
    light_paths: EnumProperty(
        name="Light Paths", description="Bounces, clamping and caustics of the reference",
        items=(("SCENE", "As in Cycles", "Those of the scene's Cycles settings"), ("OWN", "Custom", "Those below"),
               ("PAPER", "As in the Paper", "Those of the pictures that the published weights were trained with: no "
                "bounces in volumes, 4 diffuse and 4 glossy ones, adaptive sampling")))
    max_bounces: IntProperty(name="Max Bounces", default=12, min=0, max=1024,
                             description="Most bounces of a ray of the reference, whatever it bounces off")
    clamp_direct: FloatProperty(name="Clamp Direct", default=0.0, min=0.0,
                                description="Largest value of a sample of direct light; 0 is no limit")
    clamp_indirect: FloatProperty(name="Clamp Indirect", default=10.0, min=0.0,
                                  description="Largest value of a sample of light that has bounced; 0 is no limit")
    use_caustics: BoolProperty(name="Caustics", default=True,
                               description="Light that mirrors and glass throw on other surfaces")
    use_light_passes: BoolProperty(
        name="Light Passes", options=set(), update=update_sockets,
        description="Also keep Cycles' light passes: Cycles Diffuse Direct and so on, not denoised",
    )


@dataclass(frozen=True)
class FrameReference:
    """The reference of one frame, keyframes included; it outlives the evaluated scene that it was read from."""

    samples: int
    time_limit: float  # seconds; 0 is no limit
    denoise: bool
    light_passes: bool
    settings: tuple[tuple[str, object], ...]  # of the scene, that are others than Cycles' own

    @classmethod
    def read(cls, scene: bpy.types.Scene) -> FrameReference | None:
        """The settings of an evaluated scene; None without a reference."""
        chosen = scene.renderformer_v2.reference
        if not chosen.use:
            return None
        samples = scene.cycles.samples if chosen.use_scene_samples else chosen.samples
        return cls(samples, chosen.time_limit, chosen.use_denoising, chosen.use_light_passes, _own(chosen))


def _own(chosen: ReferenceSettings) -> tuple[tuple[str, object], ...]:
    settings = {}
    if chosen.denoiser != "SCENE":
        settings["cycles.denoiser"] = chosen.denoiser
    if chosen.light_paths == "OWN":
        settings |= {f"cycles.{name}": chosen.max_bounces for name in BOUNCES}
        settings |= {"cycles.sample_clamp_direct": chosen.clamp_direct,
                     "cycles.sample_clamp_indirect": chosen.clamp_indirect,
                     "cycles.caustics_reflective": chosen.use_caustics,
                     "cycles.caustics_refractive": chosen.use_caustics}
    if chosen.light_paths == "PAPER":
        settings |= {f"cycles.{name}": value for name, value in PAPER.items()}
    return tuple(settings.items())


class RENDERFORMER_OT_reference_as_in_paper(bpy.types.Operator):
    bl_idname = "renderformer_v2.reference_as_in_paper"
    bl_label = "Cycles as in the Paper"
    bl_description = ("Reference as the pictures that the published weights were trained with: up to 4096 adaptive "
                      "samples, denoised, no bounces in volumes. It takes long")
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        chosen = context.scene.renderformer_v2.reference
        chosen.use, chosen.samples, chosen.use_scene_samples, chosen.time_limit = True, PAPER_SAMPLES, False, 0
        chosen.use_denoising, chosen.denoiser, chosen.light_paths = True, "OPENIMAGEDENOISE", "PAPER"
        return {"FINISHED"}


register, unregister = classes(ReferenceSettings, RENDERFORMER_OT_reference_as_in_paper)
