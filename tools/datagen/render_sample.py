# SPDX-License-Identifier: GPL-3.0-or-later
"""One sample: the RenderScene, Views, Guides and Cycles passes of the open file, made by the engine's own code."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
import numpy as np

from tools import extension

extension.load()
from renderformer_v2.model.scene import Guides, RenderScene, View  # noqa: E402
from renderformer_v2.rf2_engine import passes as pass_table  # noqa: E402
from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera  # noqa: E402
from renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions  # noqa: E402
from renderformer_v2.rf2_engine.convert.data.report import Report  # noqa: E402
from renderformer_v2.rf2_engine.convert.scene import convert  # noqa: E402
from renderformer_v2.rf2_engine.cycles import session as cycles_session  # noqa: E402
from renderformer_v2.rf2_engine.cycles.session_options import CameraModel, SessionOptions  # noqa: E402
from renderformer_v2.rf2_engine.cycles.world import CyclesWorld  # noqa: E402
from renderformer_v2.rf2_engine.frame.first_hits import make_guides  # noqa: E402
from renderformer_v2.rf2_engine.frame_settings import Light  # noqa: E402
from renderformer_v2.rf2_engine.progress.status import Status  # noqa: E402
from renderformer_v2.rf2_engine.sampling import Sampling  # noqa: E402

from .sample_files import SampleCounts  # noqa: E402
from .scenes.cameras import Setup  # noqa: E402

MAX_EDGE = 0.25  # of the scene's longest side
REFERENCE = ("combined", "diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect",
             "transmission_direct", "transmission_indirect", "volume_direct", "volume_indirect", "emission",
             "environment")


@dataclass
class Sample:
    """What `DatagenEngine` fills in, view by view.

    Clamp Indirect is off in references; hints and "equal" pictures have it as the scene does.
    """

    counts: SampleCounts
    token_budget: int
    scene: RenderScene | None = None
    views: list[View] = field(default_factory=list)
    guides: list[Guides] = field(default_factory=list)
    passes: list[dict[str, np.ndarray]] = field(default_factory=list)
    report: Report = field(default_factory=Report)
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("convert", "cycles", "guides"), 0.0))


class DatagenEngine(bpy.types.RenderEngine):
    """Stops where F12 would start the network, and stores that one's inputs."""

    bl_idname = "RENDERFORMER_V2_DATAGEN"
    bl_label = "RenderFormer-V2 training data"
    sample: Sample | None = None  # Blender makes the instances, so the class carries the job
    error: Exception | None = None
    has_lost_modifiers = False  # read by cycles/evaluated_scene.py

    def update_render_passes(self, scene=None, renderlayer=None):
        pass_table.register(self, scene, renderlayer)

    def render(self, depsgraph):
        try:
            _render(self, depsgraph, DatagenEngine.sample)
        except Exception as error:  # Blender would print it and go on
            DatagenEngine.error = error


def _render(engine: bpy.types.RenderEngine, depsgraph, sample: Sample) -> None:
    start = time.perf_counter()
    view = convert_camera(depsgraph, engine.resolution_x, engine.resolution_y, None)
    if sample.scene is None:
        sample.scene = convert(depsgraph, view, ConversionOptions(sample.token_budget, MAX_EDGE), sample.report,
                               cycles_world=CyclesWorld(engine, depsgraph, Status(engine)))
    converted = time.perf_counter()
    cycles = depsgraph.scene_eval.cycles
    clamp, cycles.sample_clamp_indirect = cycles.sample_clamp_indirect, 0.0
    counts, has_volumes = sample.counts, bool(sample.scene.volumes)

    def render_reference(samples: int) -> dict[str, np.ndarray]:
        # Through media the world is noisy, and is denoised with what is before it.
        return cycles_session.render_passes(engine, depsgraph, SessionOptions(
            Sampling(samples), Light.ALL, CameraModel(opaque_film=has_volumes), denoise=True))

    reference = render_reference(counts.reference)
    cycles.sample_clamp_indirect = clamp
    cycles.seed += 1  # hints must not share the reference's noise
    hints = cycles_session.render_passes(engine, depsgraph, SessionOptions(
        Sampling(counts.hints), Light.TRACED, has_volumes=has_volumes))
    if counts.equal:
        reference["equal"] = render_reference(counts.equal)["combined"]
    cycles.seed -= 1
    if has_volumes:
        for name in {"combined", "equal"} & reference.keys():
            reference[name][..., :3] -= reference["environment"]
        reference["combined"][..., 3:] = hints["alpha"]
    rendered = time.perf_counter()
    sample.guides.append(make_guides(hints, sample.scene, view))
    sample.views.append(view)
    sample.passes.append({name: reference[name] for name in (*REFERENCE, *(["equal"] if counts.equal else []))})
    guided = time.perf_counter()
    for stage, seconds in zip(sample.seconds, (converted - start, rendered - converted, guided - rendered),
                              strict=True):
        sample.seconds[stage] += seconds


def prepare(threads: int) -> None:
    """Empty file, our engine, Cycles' factory settings but for the number of threads (0 = one per core)."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.utils.register_class(DatagenEngine)
    take_over(bpy.context.scene.render, threads)


def take_over(render: bpy.types.RenderSettings, threads: int) -> None:
    """Make `DatagenEngine` the engine of a scene, with this number of threads (0 = one per core)."""
    render.engine = DatagenEngine.bl_idname
    render.resolution_percentage = 100
    render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:  # Blender makes 1 of 0
        render.threads = threads
    render.use_persistent_data = True


def make_sample(setup: Setup, counts: SampleCounts, is_good: Callable[[dict], bool]) -> Sample | None:
    """Render every camera of the open file; None as soon as the passes of a view are not good.

    Raises what conversion or Cycles raise.
    """
    DatagenEngine.sample, DatagenEngine.error = Sample(counts, setup.token_budget), None
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = setup.resolution
    for camera in setup.cameras:
        bpy.context.scene.camera = camera
        bpy.ops.render.render()
        if DatagenEngine.error is not None:
            raise DatagenEngine.error
        if not is_good(DatagenEngine.sample.passes[-1]):
            return None
    return DatagenEngine.sample
