# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand at Blender's window: keys and mouse by xdotool, screenshots by ImageMagick, and waiting.

Blender's own screenshots are black with Mesa's software drivers, and its simulated Esc ends no render.

Runs inside Blender. A session is a generator that yields what it waits for: a function that gets true, or seconds.
"""
import json
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

STEP = 0.05       # seconds between two looks
PATIENCE = 400.0  # seconds for anything that is waited for
F12 = "96"        # as a keycode: its name comes with Alt on a display without a keyboard
ESC = "Escape"


class Driver:
    def __init__(self, folder: Path) -> None:
        self.folder, self.found, self._count = folder, {}, 0

    def run(self, session) -> None:
        """Drive the generator to its end, write what it found to session.json and leave Blender."""
        waiting = {"until": lambda: True, "since": time.monotonic()}

        def look() -> float | None:
            try:
                if not waiting["until"]():
                    if time.monotonic() - waiting["since"] > PATIENCE:
                        raise TimeoutError(f"waited in vain in line {', '.join(_lines(session))}")
                    return STEP
                wanted, begin = next(session), time.monotonic()
                waiting.update(since=begin, until=wanted if callable(wanted) else
                               lambda: time.monotonic() - begin >= wanted)
                return STEP
            except StopIteration:
                self._leave()
            except Exception:
                self.found["error"] = traceback.format_exc()
                self.shot("error")
                self._leave()
        bpy.app.timers.register(look, first_interval=2.0, persistent=True)

    def _leave(self) -> None:
        (self.folder / "session.json").write_text(json.dumps(self.found, indent=2))
        sys.stdout.flush()
        bpy.ops.wm.quit_blender()

    def shot(self, name: str) -> Path:
        self._count += 1
        path = self.folder / f"{self._count:02}_{name}.png"
        subprocess.run(["import", "-window", "root", str(path)], check=True)
        return path

    def pixels(self, name: str, of: bpy.types.Region, around: int = 100) -> np.ndarray:
        """(2 around, 2 around, 3) of a screenshot, from the middle of a region, upwards, 0 to 1."""
        image = bpy.data.images.load(str(self.shot(name)))
        pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)
        bpy.data.images.remove(image)
        x, y = (round(value) for value in middle(of))
        return pixels[y - around:y + around, x - around:x + around, :3]

    def key(self, code: str) -> None:
        xdotool("key", code)

    def move(self, x: float, y: float) -> None:
        """To a place of the window, in pixels from its lower left corner."""
        window = bpy.context.window_manager.windows[0]
        xdotool("mousemove", str(round(window.x + x)), str(round(_display_height() - window.y - y)))

    def press(self, down: bool = True) -> None:
        xdotool("mousedown" if down else "mouseup", "1")


def _lines(session):
    """Where a generator and those that it waits for are."""
    while session is not None and session.gi_frame:
        yield str(session.gi_frame.f_lineno)
        session = session.gi_yieldfrom


def xdotool(*arguments: str) -> None:
    subprocess.run(["xdotool", *arguments], check=True)


def _display_height() -> int:
    return int(subprocess.run(["xdotool", "getdisplaygeometry"], check=True, capture_output=True,
                              text=True).stdout.split()[1])


def area(kind: str) -> bpy.types.Area:
    return next(each for each in bpy.context.window_manager.windows[0].screen.areas if each.type == kind)


def region(of: bpy.types.Area, kind: str = "WINDOW") -> bpy.types.Region:
    return next(each for each in of.regions if each.type == kind)


def middle(of: bpy.types.Region) -> tuple[float, float]:
    return of.x + of.width / 2, of.y + of.height / 2


def is_rendering() -> bool:
    return bpy.app.is_job_running("RENDER")
