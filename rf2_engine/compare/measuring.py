# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute the metrics on a thread of their own, because they take seconds; drawing does not wait for them."""
from __future__ import annotations

import threading
import traceback

import bpy
import numpy as np

from ...model import metrics, progress
from ...model.errors import RenderCancelled
from .sources import Picture
from .windows import Window


class Box:
    """The part of a picture that is measured: pixels from the left and from the top."""

    def __init__(self, scene: bpy.types.Scene, region: str, window: Window):
        """The box in pictures that show this `window` of the frame; `region` is CompareSettings.region."""
        part = window.selected(scene.render) if region == "BORDER" else window.all
        self.width, self.height, self.left, self.right = part[:4]
        self.top, self.bottom = self.height - part.top, self.height - part.bottom

    def cut(self, pixels: np.ndarray) -> np.ndarray:
        """(H, W, 4) -> the colours of the part."""
        return pixels[self.top:self.bottom, self.left:self.right, :3]

    @property
    def area(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top from 0 to 1, upwards."""
        return (self.left / self.width, 1 - self.bottom / self.height,
                self.right / self.width, 1 - self.top / self.height)


class Measurement:
    """Of two pictures; when it has ended there is either `closeness` or an `error`, which a cancelled one has too."""

    def __init__(self, a: Picture, b: Picture, box: Box):
        self.closeness: metrics.Closeness | None = None
        self.error, self.fraction, self.box = "", 0.0, box
        self._cancelled = False
        self._pixels = box.cut(a.pixels), box.cut(b.pixels)
        self._thread = threading.Thread(target=self.run, daemon=True)

    def start(self) -> None:
        try:
            self._thread.start()
        except RuntimeError as error:  # the system gives no more threads
            self.error = f"Measuring could not start: {error}"

    def cancel(self) -> None:
        self._cancelled = True

    @property
    def is_running(self) -> bool:
        return self._thread.is_alive()

    def wait(self) -> None:
        self._thread.join()

    def run(self) -> None:
        """Measure in the calling thread."""
        try:
            with progress.reporting(self._listen):
                self.closeness = metrics.closeness(*self._pixels)
        except RenderCancelled:
            self.error = "Measuring was cancelled"
        except ValueError as error:  # too small
            self.error = str(error)
        except MemoryError:
            self.error = "Not enough memory to measure: choose a smaller render region"
        except Exception as error:
            traceback.print_exc()
            self.error = f"Measuring failed: {type(error).__name__}: {error}"

    def _listen(self, text: str, fraction: float) -> None:
        self.fraction = fraction
        if self._cancelled:
            raise RenderCancelled
