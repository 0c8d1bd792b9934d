# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert the scene without rendering it, to tell the size of a render, its time, and what will be approximated.

Python has no access to the depsgraph of a render without rendering, so the viewport's is converted, and differences are
reported. Nothing can be cancelled while Blender waits for an operator, so this is short.
"""
from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import bpy
from bpy.app.handlers import persistent

from ...model import progress
from ...model.errors import CheckpointError, RenderCancelled, SceneError
from .. import passes as pass_table
from ..convert.camera.camera import convert_camera
from ..convert.camera.eyes import count_views
from ..convert.data.report import SOME, Remark, Report, grouped
from ..convert.scene import convert
from ..cycles.bake import UnavailableBaker
from ..cycles.world import PlaceholderWorld, is_possible
from ..frame_settings import FrameSettings, Network
from ..progress import costs, memory
from ..progress.stages import CONVERT, ENCODE, TEXTURES, Work
from ..registering import handlers
from ..render_size import frame_size, render_border
from ..runtime import failure, model_cache
from ..setup import packages
from . import card, checks
from .optics import Optics
from .published_scene import network_input
from .work import Pictures, count_layers, stage_work

LONGEST = 10.0  # seconds


@dataclass(frozen=True, eq=False)  # each is its own: panels remember what they have looked up for it
class Preflight:
    """The result for one view layer. With an `error` the rest is empty except what was found before."""

    layer: str
    layers: int = 1                # that a frame renders
    views: int = 1                 # of stereoscopy, that a view layer has
    error: str = ""
    size: tuple[int, int] = (0, 0)
    triangles: int = 0
    tokens: int = 0
    blur: str = ""                 # what depth of field and motion blur cost
    state: tuple = ()              # of the settings that it was looked at with: state_of
    seconds: float | None = None   # of all view layers; None: never measured with these settings
    memory: float | None = None    # MiB that Blender will hold; None likewise
    card: str = ""                 # what is asked of a graphics card's memory
    remarks: list[Remark] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """A sentence each, without the remarks."""
        if self.error:
            return [self.error]
        width, height = self.size
        several = f"View layer {self.layer}, one of {self.layers}" if self.layers > 1 else "A render"
        time = memory = "unknown until a picture is rendered with these settings"
        if self.seconds is not None:
            time = f"about {_clock(self.seconds)}, based on earlier renders on this computer"
        if self.memory is not None:
            memory = f"Blender will use about {self.memory / 1024:.1f} GB"
        blur = [self.blur] if self.blur else []
        views = f"{self.views} views of " if self.views > 1 else ""
        return [f"{several}: {views}{width} x {height} pixels, {self.triangles} triangles for the network",
                f"Time: {time}", *blur, f"Memory: {memory}", *([self.card] if self.card else [])]


def _clock(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{seconds:.1f} s" if seconds < 10 else f"{whole} s"
    return f"{whole // 60}:{whole % 60:02} min"


last: dict[str, Preflight] = {}  # by scene


def state_of(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> tuple:
    """Whatever of the settings decides what `run` finds, the frame included; the objects of the scene are not in it."""
    ours, blenders, camera = scene.renderformer_v2, scene.render, scene.camera
    try:
        settings = FrameSettings.read(scene, layer)
    except (CheckpointError, SceneError) as error:
        settings = str(error)
    width, height = frame_size(blenders)
    lens = None
    if camera and camera.type == "CAMERA":
        lens = camera.data.type, camera.data.panorama_type, camera.data.stereo.use_spherical_stereo, (
            camera.data.dof.use_dof)
    return (settings, ours.device, width, height, render_border(width, height, blenders), scene.frame_current,
            blenders.use_motion_blur, count_views(scene), ours.lens_samples, ours.shutter_samples, lens,
            count_layers(scene), pass_table.ticked_passes(layer, pass_table.LIGHTING, scene))


def as_text(scene: bpy.types.Scene) -> str:
    latest = last.get(scene.name)
    return "" if latest is None else "\n".join([*latest.lines, *map(str, grouped(latest.remarks))])


def run(depsgraph: bpy.types.Depsgraph, listener: progress.Listener) -> Preflight:
    """Look at the view layer of a depsgraph; whatever goes wrong is in the answer, as the render would say it."""
    begin, report, layer = time.perf_counter(), Report(), depsgraph.view_layer_eval.name
    state = state_of(depsgraph.scene, depsgraph.view_layer)

    def in_time(text: str, fraction: float) -> None:
        if time.perf_counter() - begin > LONGEST:
            raise RenderCancelled()
        listener(text, fraction)

    try:
        with progress.reporting(in_time):
            return replace(_inspect(depsgraph, layer, report, begin), state=state)
    except RenderCancelled:
        return Preflight(layer, state=state, remarks=report.entries, error="This scene takes longer than "
                         f"{LONGEST:.0f} s to convert, so this is incomplete. Found so far:")
    except Exception as error:
        return Preflight(layer, state=state, error=failure.message(error), remarks=report.entries)


def _inspect(depsgraph: bpy.types.Depsgraph, layer: str, report: Report, begin: float) -> Preflight:
    scene = depsgraph.scene_eval
    packages.require()
    packages.require_cycles()
    settings = FrameSettings.read(scene, depsgraph.view_layer_eval)
    checks.check(depsgraph, settings, report)
    optics = Optics.read(depsgraph).possible(settings.light, depsgraph, report)
    width, height = frame_size(scene.render)
    view = convert_camera(depsgraph, width, height, render_border(width, height, scene.render), report)
    converted = convert(depsgraph, convert_camera(depsgraph, width, height, None), settings.conversion, report,
                        cycles_world=PlaceholderWorld() if is_possible(scene) else None,
                        baker=UnavailableBaker() if settings.bake_unknown else None)
    _report_differences(depsgraph, report)
    converting, layers = time.perf_counter() - begin, count_layers(scene)
    pictures = Pictures.read(depsgraph, settings, width, height)
    seconds = _remaining_seconds(pictures, settings, optics, len(converted))
    added = costs.measured_memory(settings.setup, model_cache.is_loaded(), pictures.views * pictures.pixels,
                                  len(converted), settings.network is Network.PUBLISHED)
    tokens = card.count_tokens(network_input(converted, view, settings, report), settings)
    return Preflight(layer, layers, pictures.views, size=(view.width, view.height), triangles=len(converted),
                     tokens=tokens, card=card.describe(card.memory(settings, tokens, pictures.pixels)),
                     blur=_describe_blur(pictures, settings, optics, seconds),
                     seconds=None if seconds is None else layers * (converting + seconds),
                     memory=None if added is None else memory.measure()[0] + added, remarks=report.entries)


def _remaining_seconds(pictures: Pictures, settings: FrameSettings, optics: Optics, triangles: int) -> float | None:
    """Expected seconds of a view layer whose scene is converted and has that many triangles; None if never measured."""
    work = stage_work(pictures, settings, optics) | {
        CONVERT: Work(1, optics.scenes - 1), ENCODE: Work(triangles, optics.shutter_samples),
        TEXTURES: Work(triangles, optics.shutter_samples * settings.network.encodes_textures)}
    return costs.measured_seconds(work, settings.setup)


def _describe_blur(pictures: Pictures, settings: FrameSettings, optics: Optics, seconds: float | None) -> str:
    """What depth of field and motion blur cost, of a render that takes so long; "" without them."""
    if optics.samples == 1:
        return ""
    unblurred = replace(optics, lens_samples=1, shutter_samples=1)
    sharp = costs.measured_seconds(stage_work(pictures, settings, unblurred), settings.setup)
    effects = ("depth of field", optics.lens_samples), ("motion blur", optics.shutter_samples)
    kinds = [name for name, count in effects if count > 1]
    times = f"{seconds / sharp:.1f}" if seconds and sharp else optics.samples
    return f"{' and '.join(kinds).capitalize()}: {optics.samples} pictures for one, about {times} times as long"


def _report_differences(depsgraph: bpy.types.Depsgraph, report: Report) -> None:
    """Say what a render shows otherwise than the viewport, whose depsgraph this is."""
    hidden, other = [], []
    for obj in depsgraph.view_layer.objects:
        if obj.hide_render:
            continue
        if not obj.visible_get(view_layer=depsgraph.view_layer):
            hidden.append(obj.name)
        elif any(_differs(modifier) for modifier in obj.modifiers):
            other.append(obj.name)
    for names, what in ((hidden, "hidden in the viewport, but rendered: not counted"),
                        (other, "modifiers, or their levels, differ between viewport and render")):
        if names:
            report.approximated("Preflight", f"{', '.join(names[:SOME])}{' ...' if len(names) > SOME else ''}: {what}")


def _differs(modifier: bpy.types.Modifier) -> bool:
    levels = modifier.show_render and getattr(modifier, "levels", 0) != getattr(modifier, "render_levels", 0)
    return modifier.show_viewport != modifier.show_render or levels


@persistent
def _forget(*_) -> None:
    last.clear()


register, _remove_handlers = handlers(("load_post", _forget))


def unregister() -> None:
    _forget()
    _remove_handlers()
