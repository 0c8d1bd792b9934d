# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a comparison: A and B, their difference and the FLIP map below, with names and numbers."""
from __future__ import annotations

import tempfile
from pathlib import Path

import blf
import bpy
import imbuf
import numpy as np

from ...model.metrics import scores as metrics
from ...model.metrics.flip import magma
from .measuring import Box
from .saving import file_format
from .sources import Picture

BACKGROUND = 0.1      # display-referred
MARGIN = 16           # pixels
TEXT = 1 / 32         # height of text over the width of a picture
SMALLEST_TEXT = 10    # pixels


def write(path: Path, scene: bpy.types.Scene, a: Picture, b: Picture, closeness: metrics.Closeness, box: Box,
          gain: float) -> None:
    """Write a PNG; A, B and the difference look as the scene's view transform shows them. Raises RuntimeError."""
    height, width, _ = a.pixels.shape
    size = max(round(width * TEXT), SMALLEST_TEXT)
    band = 2 * size
    difference = np.abs(a.pixels - b.pixels)[..., :3] * gain
    shown = _displayed(scene, np.concatenate([a.pixels[..., :3], b.pixels[..., :3], difference], 1))
    flip = np.full((height, width, 3), BACKGROUND, np.float32)
    flip[box.top:box.bottom, box.left:box.right] = magma(closeness.flip_map)

    sheet = np.full((2 * (height + band) + band + MARGIN, 2 * width + 3 * MARGIN, 3), BACKGROUND, np.float32)
    texts = (_described("A", a), _described("B", b), f"|A - B| x {gain:g}", f"FLIP {closeness.flip:.4f}")
    labels = []
    for i, (tile, text) in enumerate(zip((*np.split(shown, 3, 1), flip), texts)):
        left, top = MARGIN + i % 2 * (width + MARGIN), band + i // 2 * (height + band)
        sheet[top:top + height, left:left + width] = tile
        labels.append((_fitting(text, size, width), left, top - band // 3))
    bottom = sheet.shape[0] - MARGIN
    numbers = f"PSNR {closeness.psnr:.2f} dB    SSIM {closeness.ssim:.4f}    HDR-FLIP {closeness.hdr_flip:.4f}"
    labels.append((_fitting(numbers, size, width), MARGIN, bottom - size // 4))
    labels += _scale(sheet, MARGIN + width + MARGIN, bottom, width, size)
    _save(path, sheet)
    _write_texts(path, labels, size, sheet.shape[0])


def _described(side: str, picture: Picture) -> str:
    return f"{side}: {picture.label}"


def _fitting(text: str, size: int, width: int) -> str:
    """Shortened until it is at most `width` pixels wide."""
    blf.size(0, size)
    if blf.dimensions(0, text)[0] <= width:
        return text
    while text and blf.dimensions(0, text + "...")[0] > width:
        text = text[:-1]
    return text.rstrip() + "..."


def _scale(sheet: np.ndarray, left: int, bottom: int, width: int, size: int) -> list[tuple[str, int, int]]:
    """Draw FLIP's colours from 0 to 1 into the sheet; the labels at both ends."""
    first, last = left + 2 * size, left + width - 2 * size
    sheet[bottom - size:bottom, first:last] = magma(np.linspace(0, 1, max(last - first, 0)))
    return [("0", left + size, bottom - size // 4), ("1", last + size // 2, bottom - size // 4)]


def _displayed(scene: bpy.types.Scene, linear: np.ndarray) -> np.ndarray:
    """Through the scene's view transform: (H, W, 3) scene-linear -> display-referred, in [0, 1]."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "displayed.png")
        image = _image(linear, float_buffer=True)
        try:
            with file_format(scene, "PNG", color_mode="RGB", color_depth="8", color_management="FOLLOW_SCENE"):
                image.save_render(path, scene=scene)
            bpy.data.images.remove(image)
            image = bpy.data.images.load(path)
            image.colorspace_settings.is_data = True
            pixels = np.empty((*linear.shape[:2], 4), np.float32)
            image.pixels.foreach_get(pixels.ravel())
        finally:
            bpy.data.images.remove(image)
    return pixels[::-1, :, :3]


def _image(pixels: np.ndarray, **kind) -> bpy.types.Image:
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Comparison", width, height, **kind)
    opaque = np.pad(pixels, ((0, 0), (0, 0), (0, 1)), constant_values=1)
    image.pixels.foreach_set(np.ascontiguousarray(opaque[::-1], np.float32).ravel())
    return image


def _save(path: Path, sheet: np.ndarray) -> None:
    image = _image(sheet, is_data=True)
    try:
        image.filepath_raw, image.file_format = str(path), "PNG"
        image.save()
    finally:
        bpy.data.images.remove(image)


def _write_texts(path: Path, labels: list[tuple[str, int, int]], size: int, height: int) -> None:
    """Into a saved picture; labels are (text, left, base line from the top)."""
    picture = imbuf.load(str(path))
    with blf.bind_imbuf(0, picture):
        blf.size(0, size)
        blf.color(0, 1, 1, 1, 1)
        for text, left, base in labels:
            blf.position(0, left, height - base, 0)
            blf.draw_buffer(0, text)
    imbuf.write(picture, filepath=str(path))
    picture.free()
