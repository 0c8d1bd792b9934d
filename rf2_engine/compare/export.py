# SPDX-License-Identifier: GPL-3.0-or-later
"""Export Comparison: a PNG sheet of A, B, their difference and the FLIP map, the numbers as JSON, and file formats."""
from __future__ import annotations

import json
import tempfile
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path

import blf
import bpy
import imbuf
import numpy as np

from ...model.metrics import flip, scores
from ...model.metrics.flip import magma
from .. import compat
from .measuring import Box, Measurement
from .pictures import Picture

BACKGROUND = 0.1      # display-referred
MARGIN = 16           # pixels
TEXT = 1 / 32         # height of text over the width of a picture
SMALLEST_TEXT = 10    # pixels


def write(path: Path, scene: bpy.types.Scene, a: Picture, b: Picture, measurement: Measurement, gain: float) -> None:
    """Write a PNG and a JSON file of that name, or neither. Raises OSError and RuntimeError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as folder:
        finished = Path(folder) / path.name
        _write_sheet(finished, scene, a, b, measurement.closeness, measurement.box, gain)
        finished.with_suffix(".json").write_text(json.dumps(_numbers(a, b, measurement), indent=2) + "\n")
        _replace_all({finished.with_suffix(suffix): path.with_suffix(suffix) for suffix in (".json", ".png")})


def _replace_all(targets: dict[Path, Path]) -> None:
    """Move files to their targets on the same disk, over what is there: all, or none. Raises OSError."""
    moved = []
    try:
        for source, target in targets.items():
            if target.is_dir():
                raise IsADirectoryError(f"{target} is a folder")
            backup = source.with_name(f"{source.name}.old")
            if target.exists():
                target.replace(backup)
                moved.append((backup, target))
            source.replace(target)
            moved.append((target, source))
    except OSError:
        for now, before in reversed(moved):
            now.replace(before)
        raise


def _numbers(a: Picture, b: Picture, measurement: Measurement) -> dict:
    """What the JSON file holds."""
    closeness = measurement.closeness
    return {
        "a": {"name": a.name, **a.credits._asdict()},
        "b": {"name": b.name, **b.credits._asdict()},
        "width": a.pixels.shape[1], "height": a.pixels.shape[0],
        "region": dict(zip(("left", "bottom", "right", "top"), measurement.box.area)),
        "psnr": closeness.psnr, "ssim": closeness.ssim, "flip": closeness.flip, "lpips": closeness.lpips,
        "notes": measurement.notes,
        "pixels_per_degree": flip.PIXELS_PER_DEGREE,
        "measured": "clipped to [0, 1] and sRGB-encoded, without the view transform and alpha",
    }


def _write_sheet(path: Path, scene: bpy.types.Scene, a: Picture, b: Picture, closeness: scores.Closeness, box: Box,
                 gain: float) -> None:
    """Write a PNG; A, B and the difference look as the scene's view transform shows them. Raises RuntimeError."""
    height, width, _ = a.pixels.shape
    size = max(round(width * TEXT), SMALLEST_TEXT)
    band = 2 * size
    difference = np.abs(a.pixels - b.pixels)[..., :3] * gain
    displayed = _apply_view_transform(scene, np.concatenate([a.pixels[..., :3], b.pixels[..., :3], difference], 1))
    flip_map = np.full((height, width, 3), BACKGROUND, np.float32)
    flip_map[box.top:box.bottom, box.left:box.right] = magma(closeness.flip_map)

    sheet = np.full((2 * (height + band) + band + MARGIN, 2 * width + 3 * MARGIN, 3), BACKGROUND, np.float32)
    texts = (f"A: {a.label}", f"B: {b.label}", f"|A - B| x {gain:g}", f"FLIP {closeness.flip:.4f}")
    labels = []
    for i, (tile, text) in enumerate(zip((*np.split(displayed, 3, 1), flip_map), texts)):
        left, top = MARGIN + i % 2 * (width + MARGIN), band + i // 2 * (height + band)
        sheet[top:top + height, left:left + width] = tile
        labels.append((_shorten(text, size, width), left, top - band // 3))
    bottom = sheet.shape[0] - MARGIN
    numbers = f"PSNR {closeness.psnr:.2f} dB    SSIM {closeness.ssim:.4f}    HDR-FLIP {closeness.hdr_flip:.4f}"
    labels.append((_shorten(numbers, size, width), MARGIN, bottom - size // 4))
    labels += _draw_scale(sheet, MARGIN + width + MARGIN, bottom, width, size)
    _save_png(path, sheet)
    _write_texts(path, labels, size, sheet.shape[0])


def _shorten(text: str, size: int, width: int) -> str:
    """Cut the text until it is at most `width` pixels wide."""
    blf.size(0, size)
    if blf.dimensions(0, text)[0] <= width:
        return text
    while text and blf.dimensions(0, text + "...")[0] > width:
        text = text[:-1]
    return text.rstrip() + "..."


def _draw_scale(sheet: np.ndarray, left: int, bottom: int, width: int, size: int) -> list[tuple[str, int, int]]:
    """Draw FLIP's colours from 0 to 1 into the sheet. Returns the labels of both ends, as _write_texts takes them."""
    first, last = left + 2 * size, left + width - 2 * size
    sheet[bottom - size:bottom, first:last] = magma(np.linspace(0, 1, max(last - first, 0)))
    return [("0", left + size, bottom - size // 4), ("1", last + size // 2, bottom - size // 4)]


def _apply_view_transform(scene: bpy.types.Scene, linear: np.ndarray) -> np.ndarray:
    """Apply the scene's view transform: (H, W, 3) scene-linear -> display-referred, in [0, 1]."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "displayed.png")
        image = _new_image(linear, float_buffer=True)
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


def _new_image(pixels: np.ndarray, **kind) -> bpy.types.Image:
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Comparison", width, height, **kind)
    opaque = np.pad(pixels, ((0, 0), (0, 0), (0, 1)), constant_values=1)
    image.pixels.foreach_set(np.ascontiguousarray(opaque[::-1], np.float32).ravel())
    return image


def _save_png(path: Path, sheet: np.ndarray) -> None:
    image = _new_image(sheet, is_data=True)
    try:
        image.filepath_raw, image.file_format = str(path), "PNG"
        image.save()
    finally:
        bpy.data.images.remove(image)


def _write_texts(path: Path, labels: list[tuple[str, int, int]], size: int, height: int) -> None:
    """Write texts into a saved picture; labels are (text, left, base line from the top)."""
    picture = imbuf.load(str(path))
    with blf.bind_imbuf(0, picture):
        blf.size(0, size)
        blf.color(0, 1, 1, 1, 1)
        for text, left, base in labels:
            blf.position(0, left, height - base, 0)
            blf.draw_buffer(0, text)
    imbuf.write(picture, filepath=str(path))
    picture.free()


RESTORED = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "compression", "color_management",
            "use_exr_interleave", "views_format")  # in this order: a format decides what the later ones may be
# Where Color Management is Override: Blender resets them with the format, and when it becomes Override again.
OVERRIDDEN = ("linear_colorspace_settings.name", "display_settings.display_device", "view_settings.view_transform",
              "view_settings.look", "view_settings.exposure", "view_settings.gamma")


@contextmanager
def file_format(scene: bpy.types.Scene, name: str, colorspace: str = "", **settings):
    """Have the scene save files of this format inside, with these image settings, linear ones in this color space."""
    image_settings = scene.render.image_settings
    is_override = image_settings.color_management == "OVERRIDE"
    before = {key: attrgetter(key)(image_settings) for key in RESTORED + OVERRIDDEN * is_override
              if hasattr(image_settings, key.partition(".")[0])}
    try:
        compat.set_file_format(image_settings, name)
        for key, value in settings.items():
            setattr(image_settings, key, value)
        if colorspace and is_override:
            image_settings.linear_colorspace_settings.name = colorspace
        yield
    finally:
        for key, value in before.items():
            if value != attrgetter(key)(image_settings):
                owner, _, last = key.rpartition(".")
                setattr(getattr(image_settings, owner) if owner else image_settings, last, value)
