# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute the metrics on a thread of their own, because they take seconds; drawing does not wait for them."""
from __future__ import annotations

import threading
import traceback

import bpy
import numpy as np

from ...model import progress
from ...model.color import linear_to_srgb
from ...model.errors import RenderCancelled
from ...model.metrics import scores as metrics
from ...model.metrics.scores import excess_noise
from . import header
from .sources import Picture

NOISY = 0.2  # share of the squared difference that is worth a line: 1 dB
MOST = 0.7   # from which on an estimate without it would say little


class Box:
    """The part of a picture that is measured: pixels from the left and from the top."""

    def __init__(self, scene: bpy.types.Scene, region: str, a: Picture, b: Picture):
        """The box in pictures of one size, where both were rendered; `region` is CompareSettings.region."""
        parts = [a.window.selected(scene.render) if region == "BORDER" else a.window.all, a.rendered, b.rendered]
        self.width, self.height = parts[0][:2]
        self.left, bottom = (max(values) for values in ([p.left for p in parts], [p.bottom for p in parts]))
        self.right, top = (min(values) for values in ([p.right for p in parts], [p.top for p in parts]))
        self.right = max(self.left, self.right)
        self.top, self.bottom = self.height - max(bottom, top), self.height - bottom

    def cut(self, pixels: np.ndarray) -> np.ndarray:
        """(H, W, C) -> the part."""
        return pixels[self.top:self.bottom, self.left:self.right]

    @property
    def is_whole(self) -> bool:
        return self.area == (0, 0, 1, 1)

    @property
    def area(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top from 0 to 1, upwards."""
        return (self.left / self.width, 1 - self.bottom / self.height,
                self.right / self.width, 1 - self.top / self.height)


class Measurement:
    """Of two pictures; when it has ended there is either `closeness` or an `error`, which a cancelled one has too."""

    def __init__(self, a: Picture, b: Picture, box: Box):
        self.closeness: metrics.Closeness | None = None
        self.notes: list[str] = []  # what the numbers do not tell
        self.error, self.fraction, self.box = "", 0.0, box
        self._cancelled = False
        self._composited = composited(a, b)
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
                measured = metrics.closeness(*(pixels[..., :3] for pixels in self._pixels))
                self.notes = (self._composited + notes(*self._pixels, self.box)
                              + noise_of_b(*self._pixels, measured.psnr))
                self.closeness = measured
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


def composited(a: Picture, b: Picture) -> list[str]:
    """A line if the compositor made one of the two."""
    ours, other = (header.COMPOSITE in picture.place[1:2] for picture in (a, b))
    if ours == other:
        return []
    first, second = "AB" if ours else "BA"
    return [f"{first} went through the compositor and {second} did not: to compare renders, choose a view layer for "
            f"{first}"]


def notes(a: np.ndarray, b: np.ndarray, box: Box) -> list[str]:
    """What the metrics of two parts (H, W, 4) leave out, a line each."""
    found = [] if box.is_whole else [f"Measured: {box.right - box.left} x {box.bottom - box.top} pixels"]
    above = [100 * float((pixels[..., :3] > 1).any(-1).mean()) if pixels.size else 0.0 for pixels in (a, b)]
    if any(above):
        found.append(f"Values above 1 are clipped, but for HDR-FLIP: {above[0]:.1f} % of A's pixels, "
                     f"{above[1]:.1f} % of B's")
    if (a[..., 3] < 1).any() or (b[..., 3] < 1).any():
        off = float(np.abs(a[..., 3] - b[..., 3]).mean())
        found.append(f"Alpha is not in the metrics, colours count as over black: it is {off:.4f} off on average")
    return found


def noise_of_b(a: np.ndarray, b: np.ndarray, psnr: float) -> list[str]:
    """A line if much of the difference is noise of the reference."""
    encoded = [linear_to_srgb(pixels[..., :3]) for pixels in (a, b)]  # clipped, as for PSNR
    share = excess_noise(*encoded) * 10 ** (psnr / 10)
    if share < NOISY:
        return []
    without = f"without its noise PSNR would be about {psnr - 10 * np.log10(1 - share):.0f} dB" if share < MOST else \
        "its noise is most of the difference"
    return [f"B is noisy: {without}. Give it more samples, or denoise it"]
