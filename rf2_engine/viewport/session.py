# SPDX-License-Identifier: GPL-3.0-or-later
"""One viewport: what it was asked for last, what is ready, and the next piece of work."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ...model import progress
from ...model.compute import threads
from ...model.errors import RenderCancelled
from ..convert.data.copied import Copied
from ..convert.data.memo import Memo
from ..convert.data.report import Report
from ..runtime import failure, model_cache
from ..runtime.worker import Stopped
from . import levels
from .lighting import Lit, Look, finished, has_moved_on, light, picture
from .region_view import RegionView
from .source import State

SCENE, NETWORK = "Updating the scene", "Bouncing light"  # pieces of work; the others are levels
NAMES = {1: "full resolution", 2: "1/2", 4: "1/4", 8: "1/8"}
SAID = 1.0      # seconds that a text stays
CHANGING = 0.5  # seconds between two requests, up to which somebody is dragging something
PATIENCE = 2.0  # seconds that a piece of work for something older may still take, so that something is shown meanwhile


@dataclass(frozen=True, eq=False)
class Request:
    """What a viewport is to show."""

    copied: Copied
    state: State  # of the source that was copied
    view: RegionView
    look: Look
    asked: float = field(default_factory=time.perf_counter)

    def shows_as(self, other: Request | None) -> bool:
        return other is not None and self.of_scene == other.of_scene and self.view == other.view and (
            self.look == other.look)

    @property
    def of_scene(self) -> tuple:
        return self.state, self.look.of_scene


@dataclass(frozen=True, eq=False)
class Shown:
    """A picture that is ready."""

    pixels: np.ndarray  # (H, W, 4) as lighting.picture has it
    request: Request
    divisor: int
    seconds: float      # since it was asked for
    drawn: float        # seconds of this picture alone
    triangles: int


class Superseded(Exception):
    """Raised in a piece of work for something that is no longer wanted."""


class Session:
    """Asked on the main thread, and worked on by the worker's; each field is set by one of them, as a whole."""

    def __init__(self, redraw: Callable[[], None] = lambda: None) -> None:
        """redraw: called on the worker's thread when there is something new to show."""
        self.request: Request | None = None
        self.closed = False
        self.shown: Shown | None = None
        self.error = ""
        self.doing = ""                    # what the worker does for it now
        self._said = 0.0
        self._memo = Memo()
        self.redraw = redraw
        self._lit: Lit | None = None
        self._failed: Request | None = None
        self._undrawn: Request | None = None             # its scene is ready, and nothing was drawn of it yet
        self._changing = False                           # the request was one of several in a row
        self._dropped = False                            # the last piece of work that had to show something first
        self._done: tuple[Request, int] | None = None    # what was last drawn, and how finely
        self._refit: Request | None = None               # the scene is to be fitted to this one's view
        self._fitted: RegionView | None = None           # and was to this one's
        self._seconds: dict[tuple, dict[int, float]] = {}  # of levels, by size and triangles

    def ask(self, request: Request) -> bool:
        """Show this from now on; whether that is something new."""
        if request.shows_as(self.request):
            return False
        self._changing = request.asked - self.asked < CHANGING
        self.request = request
        return True

    @property
    def asked(self) -> float:
        return self.request.asked if self.request else 0.0

    def close(self) -> None:
        """Nobody looks at it any more."""
        self.closed, self.request, self.shown, self._memo = True, None, None, Memo()
        self.forget()

    def forget(self) -> None:
        """Drop what holds the network's memory; it is made again when needed."""
        self._lit = self._done = self._undrawn = None

    def wants(self) -> bool:
        request = self.request
        return request is not None and request is not self._failed and not request.view.is_empty and (
            self._piece(request) is not None)

    def step(self, listen: Callable[..., None]) -> None:
        """The next piece of work: the scene, its network's light, or one level of its picture."""
        newest = self.request
        request = self._next(newest)
        piece = self._piece(request) if request is not None else None
        if piece is None:
            return
        begin = time.perf_counter()
        coarse = piece == SCENE or self._done is None or not self._done[0].shows_as(request)

        def heard(text: str, fraction: float) -> None:
            listen()
            newer = self.request is not newest
            long = time.perf_counter() - begin > PATIENCE and not self._dropped
            if self.closed or newer and (long or not coarse):
                self._dropped = coarse
                raise Superseded()
            if text != self.doing and time.perf_counter() - self._said > SAID:
                self._say(text)

        count = request.look.frame.threads
        self._say(piece if isinstance(piece, str) else f"Drawing {NAMES[piece]}")
        try:
            with progress.reporting(heard), threads.limited(count):
                with progress.part(0.0, 0.0, "Loading PyTorch"):
                    threads.finish_import(model_cache.begin_import())
                with threads.team(count):
                    if piece == SCENE:
                        self._light(request)
                    elif piece == NETWORK:
                        self._finish(request)
                    else:
                        self._draw(request, piece)
            self._dropped = False
        except (Superseded, Stopped, RenderCancelled):
            pass
        except Exception as error:
            self.error, self._failed, self._undrawn = failure.message(error), newest, None
        self.doing = ""
        if self.closed:
            self.close()
        self.redraw()

    def _next(self, newest: Request | None) -> Request | None:
        """What is to be worked on: the newest, but a scene that is ready is seen before it is made anew, so that there
        are pictures while edits go on."""
        undrawn = self._undrawn
        if undrawn is None or newest is None or newest is undrawn or newest.of_scene == undrawn.of_scene:
            return newest
        return replace(undrawn, view=newest.view)

    def _say(self, text: str) -> None:
        self.doing, self._said = text, time.perf_counter()
        self.redraw()

    def _needs_scene(self, request: Request) -> bool:
        lit = self._lit
        return lit is None or (lit.state, lit.made_with) != request.of_scene or self._refit is request

    def _light(self, request: Request) -> None:
        before = None if self._refit is request else self._lit
        points = before.points if before else np.zeros((0, 3))
        whole = request.view.view(1, points)
        self._lit = light(request.copied, request.state, whole, request.look, before, Report(), self._memo)
        if before is None:
            self._fitted = request.view
        self._refit, self._done, self.error, self._undrawn = None, None, "", request

    def _finish(self, request: Request) -> None:
        made = finished(self._lit)
        if levels.divisors(request.look.finest)[-1] == self._done[1]:  # there is no finer picture to come
            self._done = None
        self._lit = made

    def _draw(self, request: Request, divisor: int) -> None:
        begin, lit = time.perf_counter(), self._lit
        # The published network is chosen by the size of the whole picture, and the same for all levels.
        longer = 0 if request.look.frame.guided else max(request.view.picture_size(1))
        view = request.view.view(divisor, lit.points, longer)
        pixels, points = picture(lit, view, request.look, divisor)
        now = time.perf_counter()
        self._known(request)[divisor] = now - begin
        self.shown = Shown(pixels, request, divisor, now - request.asked, now - begin, len(lit.scene))
        self._done, self.error, self._undrawn = (request, divisor), "", None
        if self._piece(request) is None and self._fitted != request.view and has_moved_on(lit, view, points):
            self._refit = request

    def _known(self, request: Request) -> dict[int, float]:
        """Seconds of levels as far as they were measured, for pictures of this size of a scene of this size."""
        lit = self._lit
        key = request.view.picture_size(1), lit and len(lit.scene)
        if key not in self._seconds:
            self._seconds = {key: {}}
        return self._seconds[key]

    def _piece(self, request: Request) -> str | int | None:
        """SCENE, NETWORK, or the next level to draw; None if the request is done."""
        if self._needs_scene(request):
            return SCENE
        steps = levels.divisors(request.look.finest)
        if self._done is None or not self._done[0].shows_as(request):
            return levels.first(steps, self._known(request), self._changing)
        if self._lit.is_draft:
            return NETWORK
        done = self._done[1]
        known = self._known(request)
        return levels.following(steps, done, known[done], request.look.time_limit, known)
