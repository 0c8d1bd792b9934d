# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered viewports: Blender calls `update` after changes and `draw` whenever a viewport is drawn."""
from __future__ import annotations

import weakref

import bpy
from bpy.app.handlers import persistent

from ...model.compute import process
from ...model.errors import CheckpointError, SceneError
from ..registering import handlers
from ..runtime import model_cache, running
from ..runtime.worker import worker
from ..setup import packages
from .draw import Texture, draw_message
from .pictures import ViewportSettings
from .region_view import RegionView
from .session import DisplayedPicture, Request, Session
from .source import Key, Source, hides_in, source_key
from .status import status_text

_sources: weakref.WeakValueDictionary[Key, Source] = weakref.WeakValueDictionary()


class Viewport:
    """What belongs to the engine that Blender has made for one viewport, and is freed with it."""

    def __init__(self, engine: bpy.types.RenderEngine) -> None:
        process.prepare()
        engine_reference = weakref.ref(engine)

        def redraw() -> None:
            try:
                if (alive := engine_reference()) is not None:
                    alive.tag_redraw()
            except ReferenceError:  # Blender has freed it
                session.close()

        session = self.session = Session(redraw)
        self.texture, self.source = Texture(), None
        worker.add(session)
        weakref.finalize(self, session.close)

    @property
    def is_sketching(self) -> bool:
        """Whether there is nothing to see yet, and soon will be: reading images meanwhile would only delay it."""
        session = self.session
        return self.source is not None and self.source.bare is not None and session.sketch is None and (
            session.displayed is None and session.has_work())

    @property
    def has_undrawn_sketch(self) -> bool:
        session = self.session
        return session.displayed is None and session.sketch is not None and not session.error and (
            self.texture.pixels is not session.sketch.pixels)

    def refresh(self, depsgraph: bpy.types.Depsgraph, space: bpy.types.SpaceView3D) -> bool:
        """Copy what has changed; False if there is more to do."""
        key = source_key(depsgraph, space)
        self.source = _sources.get(key) or Source()
        _sources[key] = self.source
        return not self.is_sketching and self.source.refresh(depsgraph, hides_in(space))

    def request(self, view: RegionView, settings: ViewportSettings) -> None:
        """Show what was copied last."""
        source = self.source
        is_new = source.newest and self.session.submit(Request(source.newest, source.state, view, settings))
        if is_new or self.session.has_work():
            worker.wake()


def update(engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
    """After a change of the scene, and when a viewport begins to be Rendered."""
    viewport = _viewport(engine)
    if viewport.source is not None:
        if not viewport.source.has_noted(depsgraph, viewport):  # handlers are not told of what handlers edit
            note_changes(depsgraph.scene, depsgraph)
        viewport.source.updated.add(viewport)
    _advance(engine, context, depsgraph)


def draw(engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
    viewport = _viewport(engine)
    is_read, error = (False, "") if viewport.has_undrawn_sketch else _advance(engine, context, depsgraph)
    session, region = viewport.session, context.region
    picture, message = session.displayed or session.sketch, error or session.error
    if picture is not None and not message:  # a picture of something older would make text hard to read
        viewport.texture.draw(engine, depsgraph.scene, picture.pixels, _rectangle(picture, region))
    engine.update_stats("", "" if error else status_text(session, is_reading=not is_read))
    if message:
        engine.update_stats("", message.split(":")[0])
        draw_message(message, region.width, region.height)
    if not is_read and not viewport.is_sketching:
        engine.tag_redraw()


def _advance(engine, context, depsgraph) -> tuple[bool, str]:
    """Whether the scene was read to its end, and why nothing can be shown."""
    viewport, scene = _viewport(engine), depsgraph.scene
    if running.is_under_way():
        return True, ""
    try:
        packages.require()
        settings = ViewportSettings.read(scene, depsgraph.view_layer)
    except (CheckpointError, SceneError, packages.MissingPackages) as error:
        return True, str(error)
    is_read = viewport.refresh(depsgraph, context.space_data)
    if is_read or viewport.source.bare is not None:
        view = RegionView.read(context.region.width, context.region.height, context.region_data, context.space_data,
                               scene, context.preferences.system.pixel_size)
        viewport.request(view, settings)
    return is_read, viewport.source.error


def _rectangle(picture: DisplayedPicture, region: bpy.types.Region) -> tuple[int, int, int, int]:
    """Where a picture is drawn: a region that has another size now shows it stretched until there is a new one."""
    x0, x1, y0, y1 = picture.request.view.rectangle
    width, height = picture.request.view.size
    across, up = region.width / width, region.height / height
    return round(x0 * across), round(x1 * across), round(y0 * up), round(y1 * up)


def _viewport(engine) -> Viewport:
    if getattr(engine, "viewport", None) is None:
        engine.viewport = Viewport(engine)
    return engine.viewport


@persistent
def note_changes(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Note what the last evaluation of a depsgraph has changed, for all viewports that show it."""
    if depsgraph is None or depsgraph.mode != "VIEWPORT" or not _sources:
        return
    changed = source_key(depsgraph)
    for key, source in list(_sources.items()):
        if key[:len(changed)] == changed:
            source.note(depsgraph)


@persistent
def note_undo(*_) -> None:
    """Whatever was read may have become something else."""
    for source in list(_sources.values()):
        source.changes.add_everything()


@persistent
def forget(*_) -> None:
    """Another file is about to be opened."""
    for session in worker.works():
        session.close()
    _sources.clear()


@persistent
def resume(*_) -> None:
    """A render has ended."""
    for session in worker.works():
        session.redraw()
    worker.wake()


def _forget_scenes() -> None:
    for session in worker.works():
        session.forget()


_add_handlers, _remove_handlers = handlers(
    ("depsgraph_update_post", note_changes), ("frame_change_post", note_changes), ("undo_post", note_undo),
    ("redo_post", note_undo), ("load_pre", forget), ("render_complete", resume), ("render_cancel", resume))


def register() -> None:
    model_cache.holders.append(_forget_scenes)
    _add_handlers()


def unregister() -> None:
    _remove_handlers()
    forget()
    worker.stop()
    model_cache.holders.remove(_forget_scenes)
