# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the engine: `scene.renderformer_v2`, and overrides by view layer."""
from __future__ import annotations

import os

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..model.errors import CheckpointError
from ..model.published.bundle_files import AUTOMATIC, LARGE, SMALL
from ..model.weights.presets import BUNDLED
from .passes import update_sockets
from .reference_settings import ReferenceSettings
from .registering import classes, pairs, pointer
from .setup import published_weights
from .setup.display import redraw_areas


def _redraw_viewports(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Viewports follow scripts, too: without a function here Blender does not even tag the scene."""
    redraw_areas("VIEW_3D")


class RenderFormerViewportSettings(bpy.types.PropertyGroup):
    """Rendered viewports: `scene.renderformer_v2.viewport`."""

    token_budget: IntProperty(
        name="Max Triangles", update=_redraw_viewports, default=2048, min=256, soft_max=16384, max=1 << 20,
        step=256,
        description="Maximum triangles sent to the network for Rendered viewports. Fewer triangles react faster to "
                    "changes",
    )
    resolution: EnumProperty(
        name="Resolution", update=_redraw_viewports, default="1",
        description="The finest picture of a viewport. Pictures of 1/8, 1/4 and 1/2 of its pixels along each side "
                    "come first",
        items=(("1", "Full", "All pixels of the viewport", 0), ("2", "1/2", "Half as many along each side", 1),
               ("4", "1/4", "A quarter along each side", 2), ("8", "1/8", "An eighth along each side", 3)),
    )
    time_limit: FloatProperty(
        name="Time Limit", update=_redraw_viewports, default=10.0, min=0.0, soft_max=60.0, subtype="TIME_ABSOLUTE",
        description="Leave out finer pictures that are expected to take longer than this, in seconds. 0 sets no limit",
    )


class RenderFormerSettings(bpy.types.PropertyGroup):
    weights_source: EnumProperty(
        name="Weights", update=update_sockets,
        items=(
            ("BUNDLED", "Bundled (small)", "The small network that comes with the add-on and works offline", 0),
            ("FOLDER", "Folder", "A folder with weights on this computer", 1),
            ("PUBLISHED", "Published (large)",
             "The paper's weights. Download them or choose their folder in the add-on's preferences", 2),
        ),
    )
    weights_folder: StringProperty(
        name="Folder", update=update_sockets, subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Folder that holds the weights, for example renderformer-v2",
    )
    transformer: EnumProperty(
        name="Network Resolution", update=_redraw_viewports,
        description="The size of the pictures that the published network was trained with. Both networks know scenes "
                    "of up to 65536 triangles: raise Max Triangles as far as memory and time allow",
        items=(
            (AUTOMATIC, "Automatic", "The second for pictures from 2048 pixels, else the first; or the one that is "
             "there", 0),
            (SMALL, "512", "Trained with pictures of 512 x 512 pixels, all of them whole scenes", 1),
            (LARGE, "2048", "Trained with parts of pictures of 2048 x 2048 pixels: for fine detail", 2),
        ),
    )
    device: EnumProperty(
        name="Device", update=_redraw_viewports,
        items=(
            ("auto", "Automatic", "Use CUDA, Metal or the CPU: the first one that is available", 0),
            ("cpu", "CPU", "The processor", 1),
            ("cuda", "CUDA", "An NVIDIA GPU (or AMD's through ROCm)", 2),
            ("mps", "Metal", "The GPU of an Apple computer", 3),
        ),
    )
    card: IntProperty(
        name="GPU", update=_redraw_viewports, default=0, min=0, soft_max=8, max=64,
        description="Which of several GPUs, counted from 1. 0 is the one with the most memory",
    )
    precision: EnumProperty(
        name="Precision", update=_redraw_viewports,
        items=(
            ("auto", "Automatic", "Half precision if the hardware supports it", 0),
            ("fp32", "Float32", "Slowest and most exact", 1),
            ("bf16", "BFloat16", "Half precision with the range of Float32", 2),
            ("fp16", "Float16", "Half precision, for GPUs", 3),
        ),
    )
    token_budget: IntProperty(
        name="Max Triangles", default=4096, min=256, soft_max=131072, max=1 << 20, step=256,
        description="Maximum triangles sent to the network. Denser meshes are simplified for it, but not for rays. "
                    "More triangles give finer textures in bounced light, but take more time and memory",
    )
    max_edge: FloatProperty(
        name="Largest Triangle", update=_redraw_viewports, default=0.2, min=0.005, max=1.0, precision=3,
        description="Divide triangles with longer edges, up to Max Triangles, so that light can vary across "
                    "large surfaces. As a fraction of the scene's longest side",
    )
    as_is: BoolProperty(
        name="Use Scene Units Unscaled", update=_redraw_viewports,
        description="Give the scene to the network as it is: 1 m is one unit of the network, around the world's "
                    "origin, and light is as bright as it is. For scenes of the paper, and others that were made for "
                    "the published weights: about 1 m wide, with small lamps of radiance 300 to 5000. Otherwise what "
                    "the camera sees is scaled to that size, and the light to that brightness",
    )
    paper_lamps: BoolProperty(
        name="Lamps as in the Paper", update=_redraw_viewports,
        description="Published weights only: each lamp becomes one small triangle that faces the scene from 2.1 to 2.7 "
                    "times its size away, as in the scenes that they were trained with, and brings it as much light. "
                    "Lamps inside the scene stay where they are. Shadows are those of the new place",
    )
    guide_samples: IntProperty(
        name="Max Samples", default=0, min=0, soft_max=128, max=1024,
        description="The most camera rays per pixel that Cycles traces to find what is seen and, if Light is With "
                    "Cycles, its direct light. More samples give less noise and smoother edges. The time of the "
                    "network does not depend on them. 0 chooses by the size of the picture, so that tracing takes "
                    "about as long as the rest: 8 from 512x512 pixels on, up to 128 in small ones",
    )
    use_adaptive_sampling: BoolProperty(
        name="Noise Threshold", default=True,
        description="Give pixels whose direct light is clean fewer samples, as Cycles does. It looks at the noise "
                    "after every 16 samples. Greyed out where it cannot act: with 16 samples or fewer, which "
                    "pictures have by default unless they are small, and where Light is not With Cycles",
    )
    adaptive_threshold: FloatProperty(
        name="Noise Threshold", default=0.02, min=0.0001, soft_min=0.001, max=1.0, precision=4,
        description="Noise at which a pixel has enough samples. Lower values reduce noise and take longer. Acts "
                    "above 16 samples, where Light is With Cycles",
    )
    adaptive_min_samples: IntProperty(
        name="Min Samples", default=24, min=0, soft_max=128, max=1024,
        description="Noise is not looked at before pixels have more samples than this, so that small lights and fine "
                    "details are found. 0 lets Cycles choose by Noise Threshold, without which this does not act",
    )
    # Has no effect: files and presets of earlier versions have it.
    more_when_small: BoolProperty(name="More in Small Pictures", default=True, options={"HIDDEN"})

    lens_samples: IntProperty(
        name="Lens Samples", default=2, min=1, soft_max=64, max=1024,
        description="Points on the lens that the picture is rendered from, for cameras with Depth of Field. 1 disables "
                    "it. The network and Cycles render the picture once per sample: 2 take about twice as long as a "
                    "sharp picture; more are smoother",
    )
    shutter_samples: IntProperty(
        name="Shutter Samples", default=2, min=1, soft_max=64, max=1024,
        description="Moments at which the picture is rendered while the shutter is open, with Motion Blur. 1 disables "
                    "it. The network and Cycles render the picture once per sample: 2 take about twice as long as a "
                    "sharp picture. Together with Lens Samples, each sample has a point and a moment, and the larger "
                    "number is used",
    )
    light: EnumProperty(
        name="Light", update=update_sockets,
        items=(
            ("TRACED", "With Cycles", "Cycles traces direct light and what smooth mirrors and glass show, with the "
                                      "samples below. The network knows an estimate of all light, too, and decides "
                                      "which to believe where. Bundled network only", 0),
            ("NETWORK", "Network and Rays", "Cycles finds only what the camera sees. Rays between the surfaces "
                                            "estimate all light, and the network corrects it", 1),
            ("TRANSFORMER", "Transformer Alone", "Cycles finds only what the camera sees, and no ray is traced for "
                                                 "light: shadows, bounces, mirrors and media are the network's work, "
                                                 "as in the paper. Quick, and the least exact", 2),
        ),
    )
    bake_unknown: BoolProperty(
        name="Bake Unsupported Nodes",
        description="Let Cycles bake nodes that this engine cannot evaluate, such as Bevel, Ambient Occlusion, "
                    "Wireframe and Script, on a copy of the scene in a Blender in the background. This takes a few "
                    "seconds to start, and for each such node and thousand triangles about as long as Cycles needs to "
                    "load the scene and render a small picture. Otherwise the inputs behind such nodes keep their own "
                    "values",
    )
    threads_mode: EnumProperty(
        name="Threads Mode", update=_redraw_viewports,
        items=(
            ("AUTO", "Automatic", "Use Blender's own setting, by default one thread per core", 0),
            ("FIXED", "Fixed", "Use the number of threads below, to leave cores to other programs", 1),
        ),
    )
    threads: IntProperty(name="Threads", default=1, min=1, max=1024, update=_redraw_viewports,
                         description="Number of processor threads for Cycles and the network")
    reference: PointerProperty(type=ReferenceSettings)
    viewport: PointerProperty(type=RenderFormerViewportSettings)

    def chosen_device(self) -> str:
        """As model.renderer.Renderer takes it: "cuda:1" is the second GPU."""
        return f"cuda:{self.card - 1}" if self.card and self.device == "cuda" else self.device

    def weights(self) -> str:
        """The bundled preset's name or an absolute folder, as model.renderer.Renderer takes it.

        Raises CheckpointError when no folder is chosen, or the published weights are not complete.
        """
        if self.weights_source == "PUBLISHED":
            return str(published_weights.require())
        if self.weights_source == "BUNDLED":
            return BUNDLED
        if not self.weights_folder:
            raise CheckpointError("Weights is set to Folder, but no folder is chosen: choose one in Render Properties "
                                  "> RenderFormer-V2")
        return os.path.expanduser(bpy.path.abspath(self.weights_folder))


class RenderFormerLayerSettings(bpy.types.PropertyGroup):
    samples: IntProperty(
        name="Max Samples", default=0, min=0, soft_max=128, max=1024,
        description="Max Samples for this view layer. 0 uses that in Render Properties",
    )


register, unregister = pairs(
    classes(RenderFormerViewportSettings, RenderFormerSettings, RenderFormerLayerSettings),
    pointer(bpy.types.ViewLayer, "renderformer_v2", RenderFormerLayerSettings),
    pointer(bpy.types.Scene, "renderformer_v2", RenderFormerSettings))
