# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute the metrics on a thread of their own: they take seconds, and drawing must not wait for them."""
from __future__ import annotations

import threading
import traceback

import bpy
import numpy as np

from ...model import progress
from ...model.errors import RenderCancelled
from ...model.metrics import scores
from ...model.pictures import linear_to_srgb
from . import header
from .pictures import Picture

NOISY = 0.2         # share of noise in the squared difference that is worth a line: 1 dB
MOSTLY_NOISY = 0.7  # share above which an estimate of the rest would say little


class Box:
    """The part of a picture that is measured: pixels from the left and from the top."""

    def __init__(self, scene: bpy.types.Scene, region: str, a: Picture, b: Picture):
        """The box in two pictures of one size, where both were rendered; `region` is CompareSettings.region."""
        selected = a.crop.in_render_region(scene.render) if region == "BORDER" else a.crop.picture
        crops = [selected, a.rendered, b.rendered]
        self.width, self.height = crops[0][:2]
        self.left, bottom = max(crop.left for crop in crops), max(crop.bottom for crop in crops)
        self.right, top = min(crop.right for crop in crops), min(crop.top for crop in crops)
        self.right = max(self.left, self.right)
        self.top, self.bottom = self.height - max(bottom, top), self.height - bottom

    def cut(self, pixels: np.ndarray) -> np.ndarray:
        """(H, W, C) -> the part of it inside the box."""
        return pixels[self.top:self.bottom, self.left:self.right]

    @property
    def is_full(self) -> bool:
        return self.area == (0, 0, 1, 1)

    @property
    def area(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top from 0 to 1, upwards."""
        return (self.left / self.width, 1 - self.bottom / self.height,
                self.right / self.width, 1 - self.top / self.height)


class Measurement:
    """The metrics of two pictures: in the end there is either `closeness` or, also if cancelled, an `error`."""

    def __init__(self, a: Picture, b: Picture, box: Box):
        self.closeness: scores.Closeness | None = None
        self.notes: list[str] = []  # what the numbers leave out
        self.error, self.fraction, self.box = "", 0.0, box
        self._cancelled = False
        self._compositing_notes = _note_compositing(a, b)
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
                closeness = scores.compare(*(pixels[..., :3] for pixels in self._pixels))
                self.notes = (self._compositing_notes + _note_pixels(*self._pixels, self.box)
                              + _note_noise(*self._pixels, closeness.psnr))
                self.closeness = closeness
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


def _note_compositing(a: Picture, b: Picture) -> list[str]:
    """A line if only one of the two went through the compositor."""
    is_a, is_b = (header.COMPOSITE in picture.path[1:2] for picture in (a, b))
    if is_a == is_b:
        return []
    first, second = "AB" if is_a else "BA"
    return [f"{first} went through the compositor and {second} did not: to compare renders, choose a view layer for "
            f"{first}"]


def _note_pixels(a: np.ndarray, b: np.ndarray, box: Box) -> list[str]:
    """Lines about what the metrics of two parts (H, W, 4) leave out."""
    notes = [] if box.is_full else [f"Measured: {box.right - box.left} x {box.bottom - box.top} pixels"]
    above = [100 * float((pixels[..., :3] > 1).any(-1).mean()) if pixels.size else 0.0 for pixels in (a, b)]
    if any(above):
        notes.append(f"Values above 1 are clipped, but for HDR-FLIP: {above[0]:.1f} % of A's pixels, "
                     f"{above[1]:.1f} % of B's")
    if (a[..., 3] < 1).any() or (b[..., 3] < 1).any():
        difference = float(np.abs(a[..., 3] - b[..., 3]).mean())
        notes.append(f"Alpha is not in the metrics, colours count as over black: it is {difference:.4f} off on average")
    return notes


def _note_noise(a: np.ndarray, b: np.ndarray, psnr: float) -> list[str]:
    """A line if much of the difference is noise of the reference."""
    encoded = [linear_to_srgb(pixels[..., :3]) for pixels in (a, b)]  # clipped, as for PSNR
    share = scores.excess_noise(*encoded) * 10 ** (psnr / 10)
    if share < NOISY:
        return []
    if share < MOSTLY_NOISY:
        consequence = f"without its noise PSNR would be about {psnr - 10 * np.log10(1 - share):.0f} dB"
    else:
        consequence = "its noise is most of the difference"
    return [f"B is noisy: {consequence}. Give it more samples, or denoise it"]
