# SPDX-License-Identifier: GPL-3.0-or-later
"""One sample: the RenderScene, Views, Guides and Cycles passes of the open file, made by the engine's own code."""
from __future__ import annotations

import time
from dataclasses import dataclass, field

import bpy
import numpy as np

from tools import extension

extension.load()
from renderformer_v2.model.light.specular.ends import add_path_ends  # noqa: E402
from renderformer_v2.model.scene import Guides, RenderScene, View  # noqa: E402
from renderformer_v2.rf2_engine import passes as pass_table  # noqa: E402
from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera  # noqa: E402
from renderformer_v2.rf2_engine.convert.report import Report  # noqa: E402
from renderformer_v2.rf2_engine.convert.scene import convert  # noqa: E402
from renderformer_v2.rf2_engine.cycles import session as cycles_session  # noqa: E402
from renderformer_v2.rf2_engine.cycles.world import CyclesWorld  # noqa: E402
from renderformer_v2.rf2_engine.frame.guides import make_guides  # noqa: E402
from renderformer_v2.rf2_engine.progress.status import Status  # noqa: E402
from renderformer_v2.rf2_engine.settings import Light  # noqa: E402

from .cameras import Setup  # noqa: E402
from .shards import HINT_SAMPLES  # noqa: E402

MAX_EDGE = 0.25  # of the scene's longest side
REFERENCE = ("combined", "diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect",
             "transmission_direct", "transmission_indirect", "volume_direct", "volume_indirect", "emission",
             "environment")


@dataclass
class Sample:
    """What the engine class below fills in, view by view.

    References are not clamped, hints and the pictures beside them are as the scene has it.
    """

    samples: int
    token_budget: int
    equal: int = 0  # samples of a picture as it would be set beside ours, in the pass "equal"
    hints: int = HINT_SAMPLES
    scene: RenderScene | None = None
    views: list[View] = field(default_factory=list)
    guides: list[Guides] = field(default_factory=list)
    passes: list[dict[str, np.ndarray]] = field(default_factory=list)
    report: Report = field(default_factory=Report)
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("convert", "cycles", "guides"), 0.0))


class DatagenEngine(bpy.types.RenderEngine):
    """Stops where F12 would start the network, and keeps what it would have been given."""

    bl_idname = "RENDERFORMER_V2_DATAGEN"
    bl_label = "RenderFormer-V2 training data"
    sample: Sample | None = None  # Blender makes the instances, so the class carries the job
    error: Exception | None = None
    emptied = False  # as cycles_run.py has it of an engine

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
        sample.scene = convert(depsgraph, view, token_budget=sample.token_budget, max_edge=MAX_EDGE,
                               report=sample.report, by_cycles=CyclesWorld(engine, depsgraph, Status(engine)))
    converted = time.perf_counter()
    cycles = depsgraph.scene_eval.cycles
    clamp, cycles.sample_clamp_indirect = cycles.sample_clamp_indirect, 0.0
    found = cycles_session.render_passes(engine, depsgraph, samples=sample.samples, light=Light.ALL, denoise=True)
    cycles.sample_clamp_indirect = clamp
    cycles.seed += 1  # noise that they share with the reference would be a hint too many
    hints = cycles_session.render_passes(engine, depsgraph, samples=sample.hints, light=Light.TRACED,
                                         hazy=bool(sample.scene.volumes))
    if sample.equal:
        few = cycles_session.render_passes(engine, depsgraph, samples=sample.equal, light=Light.ALL, denoise=True)
        found["equal"] = few["combined"]
    cycles.seed -= 1
    rendered = time.perf_counter()
    sample.guides.append(add_path_ends(make_guides(hints, sample.scene, view), sample.scene, view))
    sample.views.append(view)
    sample.passes.append({name: found[name] for name in (*REFERENCE, *(["equal"] if sample.equal else []))})
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
    """Make `DatagenEngine` the engine of a scene, with so many threads (0 = one per core)."""
    render.engine = DatagenEngine.bl_idname
    render.resolution_percentage = 100
    render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:  # Blender makes 1 of 0
        render.threads = threads
    render.use_persistent_data = True


def make_sample(setup: Setup, samples: int, good, equal: int = 0, hints: int = HINT_SAMPLES) -> Sample | None:
    """Render every camera of the open file; None as soon as `good(passes)` is not true of a view.

    Raises what conversion or Cycles raise.
    """
    DatagenEngine.sample, DatagenEngine.error = Sample(samples, setup.token_budget, equal, hints), None
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = setup.resolution
    for camera in setup.cameras:
        bpy.context.scene.camera = camera
        bpy.ops.render.render()
        if DatagenEngine.error is not None:
            raise DatagenEngine.error
        if not good(DatagenEngine.sample.passes[-1]):
            return None
    return DatagenEngine.sample
