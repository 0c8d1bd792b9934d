# SPDX-License-Identifier: GPL-3.0-or-later
"""One viewport: its latest request, what is ready, and the next piece of work."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ...model import progress
from ...model.camera import view_rays
from ...model.compute import threads
from ...model.errors import RenderCancelled
from ..convert.data.cache import ConversionCache
from ..convert.data.copied import CopiedScene
from ..convert.data.report import Report
from ..convert.sketch import PIXELS, Sketch
from ..runtime import failure, model_cache
from ..runtime.worker import Stopped
from . import levels
from .pictures import (
    PreparedScene,
    ViewportSettings,
    finish_draft,
    is_quick,
    needs_refit,
    prepare_scene,
    render_picture,
)
from .region_view import RegionView
from .source import State

SKETCH, SCENE, NETWORK = "Finding surfaces", "Updating the scene", "Bouncing light"  # pieces of work, beside levels
NAMES = {1: "full resolution", 2: "1/2", 4: "1/4", 8: "1/8"}
TEXT_STAYS = 1.0  # seconds
DRAGGING = 0.5    # seconds between two requests, up to which somebody is dragging something
PATIENCE = 2.0    # seconds that a piece of work for an older request may still take, so that pictures go on appearing


@dataclass(frozen=True, eq=False)
class Request:
    """What a viewport is to show."""

    copied: CopiedScene
    state: State  # of the source that was copied
    view: RegionView
    settings: ViewportSettings
    requested_at: float = field(default_factory=time.perf_counter)

    @property
    def is_bare(self) -> bool:
        """Whether the scene is still being read, and what was copied has no images."""
        return not self.state[1]

    def looks_like(self, other: Request | None) -> bool:
        return other is not None and self.scene_key == other.scene_key and self.view == other.view and (
            self.settings == other.settings)

    @property
    def scene_key(self) -> tuple:
        return self.state, self.settings.scene_key


@dataclass(frozen=True, eq=False)
class DisplayedPicture:
    """A picture that is ready."""

    pixels: np.ndarray  # (H, W, 4) as render_picture returns it
    request: Request
    divisor: int
    seconds: float      # since it was requested
    triangles: int


class Superseded(Exception):
    """Raised in a piece of work for something that is no longer needed."""


class Session:
    """Requests come on the main thread, work is done on the worker's; each field is set by one of them, as a whole."""

    def __init__(self, redraw: Callable[[], None] = lambda: None) -> None:
        """redraw: called on the worker's thread when there is something new to show."""
        self.request: Request | None = None
        self.closed = False
        self.displayed: DisplayedPicture | None = None
        self.sketch: DisplayedPicture | None = None  # unlit, until there is the first picture
        self._sketched: tuple[Request, Sketch] | None = None  # its request, and what it was drawn of
        self.error = ""
        self.activity = ""                 # what the worker does for it now
        self._activity_since = 0.0
        self._cache = ConversionCache()
        self.redraw = redraw
        self._scene: PreparedScene | None = None
        self._failed_request: Request | None = None
        self._undrawn_request: Request | None = None     # its scene is ready, and nothing was drawn of it yet
        self._is_dragged = False                         # the request was one of several in a row
        self._was_dropped = False                        # the last piece of work that had to show something first
        self._last_drawn: tuple[Request, int] | None = None  # and its divisor
        self._refit_request: Request | None = None       # the scene is to be fitted to this one's view
        self._fitted_view: RegionView | None = None      # and was to this one
        self._level_seconds: dict[tuple, dict[int, float]] = {}  # by size and triangles, then by divisor

    def submit(self, request: Request) -> bool:
        """Show this from now on; returns whether that is something new."""
        if request.looks_like(self.request):
            return False
        self._is_dragged = request.requested_at - self.requested_at < DRAGGING
        self.request = request
        return True

    @property
    def requested_at(self) -> float:
        return self.request.requested_at if self.request else 0.0

    def close(self) -> None:
        """The viewport is gone."""
        self.closed, self.request, self.displayed, self._cache = True, None, None, ConversionCache()
        self.sketch = self._sketched = None
        self.forget()

    def forget(self) -> None:
        """Drop what holds the network's memory; it is made again when needed."""
        self._scene = self._last_drawn = self._undrawn_request = None

    def has_work(self) -> bool:
        request = self.request
        return request is not None and request is not self._failed_request and not request.view.is_empty and (
            self._next_piece(request) is not None)

    def step(self, listen: Callable[..., None]) -> None:
        """The next piece of work: the scene, its network's light, or one level of its picture."""
        newest = self.request
        request = self._request_to_work_on(newest)
        piece = self._next_piece(request) if request is not None else None
        if piece is None:
            return
        begin = time.perf_counter()
        shows_nothing_yet = piece in (SKETCH, SCENE) or self._last_drawn is None or (
            not self._last_drawn[0].looks_like(request))

        def check(text: str, fraction: float) -> None:
            listen()
            is_outdated = self.request is not newest
            is_long = time.perf_counter() - begin > PATIENCE and not self._was_dropped and piece != SKETCH
            if self.closed or is_outdated and (is_long or not shows_nothing_yet):
                self._was_dropped = shows_nothing_yet
                raise Superseded()
            if text != self.activity and time.perf_counter() - self._activity_since > TEXT_STAYS:
                self._show_activity(text)

        thread_count = request.settings.frame.threads
        self._show_activity(piece if isinstance(piece, str) else f"Drawing {NAMES[piece]}")
        try:
            with progress.reporting(check), threads.limited(thread_count):
                if piece in (SKETCH, SCENE) and self.displayed is None:
                    self._draw_sketch(request)
                if piece != SKETCH:
                    with progress.part(0.0, 0.0, "Loading PyTorch"):
                        threads.finish(model_cache.begin_import())
                    with threads.team(thread_count):
                        self._work(request, piece)
            self._was_dropped = False
        except (Superseded, Stopped, RenderCancelled):
            pass
        except Exception as error:
            self.error, self._failed_request, self._undrawn_request = failure.message(error), newest, None
        self.activity = ""
        if self.closed:
            self.close()
        self.redraw()

    def _work(self, request: Request, piece: str | int) -> None:
        """What needs PyTorch."""
        if piece == SCENE:
            self._prepare(request)
        elif piece == NETWORK:
            self._finish_draft(request)
        else:
            self._draw(request, piece)

    def _request_to_work_on(self, newest: Request | None) -> Request | None:
        """The newest; but a scene that is ready is drawn before it is made anew, so that pictures go on appearing while
        it is edited."""
        undrawn = self._undrawn_request
        if undrawn is None or newest is None or newest is undrawn or newest.scene_key == undrawn.scene_key:
            return newest
        return replace(undrawn, view=newest.view)

    def _show_activity(self, text: str) -> None:
        self.activity, self._activity_since = text, time.perf_counter()
        self.redraw()

    def _needs_scene(self, request: Request) -> bool:
        scene = self._scene
        return scene is None or self._refit_request is request or (
            scene.state, scene.settings.scene_key) != request.scene_key

    def _draw_sketch(self, request: Request) -> None:
        """Surfaces in their own colours: light takes seconds in a large scene, and a cold PyTorch in any."""
        last, sketch = self._sketched or (None, None)
        if request.looks_like(last):
            return
        if last is None or last.copied is not request.copied:
            sketch = Sketch(request.copied, sketch)
        divisor = next((divisor for divisor in (1, 2, 4) if np.prod(request.view.picture_size(divisor)) <= PIXELS), 8)
        points = sketch.triangles.reshape(-1, 3) if request.view.is_orthographic else sketch.triangles[:0, 0]
        rays = view_rays(request.view.view(divisor, points))
        pixels = sketch.picture(*rays, request.settings.frame.film_transparent)
        self.sketch = DisplayedPicture(pixels, request, divisor, time.perf_counter() - request.requested_at,
                                       len(sketch.triangles))
        self._sketched = request, sketch
        self.redraw()

    def _prepare(self, request: Request) -> None:
        before = None if self._refit_request is request else self._scene
        points = before.visible_corners if before else np.zeros((0, 3))
        full_view = request.view.view(1, points)
        self._scene = prepare_scene(request.copied, request.state, full_view, request.settings, before, Report(),
                                    self._cache)
        if before is None:
            self._fitted_view = request.view
        self._refit_request, self._last_drawn, self.error, self._undrawn_request = None, None, "", request

    def _finish_draft(self, request: Request) -> None:
        finished = finish_draft(self._scene)
        if levels.divisors(request.settings.finest)[-1] == self._last_drawn[1]:  # there is no finer picture to come
            self._last_drawn = None
        self._scene = finished

    def _draw(self, request: Request, divisor: int) -> None:
        begin, scene = time.perf_counter(), self._scene
        # The same transformer draws all levels: that for the size of the whole picture.
        longer_side = max(request.view.picture_size(1)) if request.settings.frame.network.depends_on_size else 0
        view = request.view.view(divisor, scene.visible_corners, longer_side)
        pixels, points = render_picture(scene, view, request.settings, divisor)
        now = time.perf_counter()
        self._measured_seconds(request)[divisor] = now - begin
        self.displayed = DisplayedPicture(pixels, request, divisor, now - request.requested_at, len(scene.scene))
        self._last_drawn, self.error, self._undrawn_request = (request, divisor), "", None
        self.sketch = self._sketched = None
        if self._next_piece(request) is None and self._fitted_view != request.view and needs_refit(scene, view, points):
            self._refit_request = request

    def _measured_seconds(self, request: Request) -> dict[int, float]:
        """Seconds by divisor as far as they were measured, for pictures of this size of a scene of this size."""
        key = request.view.picture_size(1), self._scene and len(self._scene.scene)
        if key not in self._level_seconds:
            self._level_seconds = {key: {}}
        return self._level_seconds[key]

    def _next_piece(self, request: Request) -> str | int | None:
        """SKETCH, SCENE, NETWORK, or the divisor of the next level to draw; None if the request is done."""
        if request.is_bare:
            is_drawn = self.displayed is not None or request.looks_like(self._sketched and self._sketched[0])
            return None if is_drawn else SKETCH
        if self._needs_scene(request):
            return SCENE
        divisors, seconds = levels.divisors(request.settings.finest), self._measured_seconds(request)
        if self._last_drawn is None or not self._last_drawn[0].looks_like(request):
            return levels.first(divisors, seconds, self._is_dragged)
        last = self._last_drawn[1]
        following = levels.following(divisors, last, seconds[last], request.settings.time_limit, seconds)
        if self._scene.is_draft and not (following and is_quick(following, request.settings)):
            return NETWORK
        return following
