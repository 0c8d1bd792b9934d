# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as Cycles looks them up: which picture, how alpha and colour space count, and what is missing."""
from __future__ import annotations

import bpy
import numpy as np

from .....model.color import srgb_to_linear
from .... import compat
from .image_files import frame_number, scene_linear, stored_pixels
from .pyramid import Pyramid, area_resample

MISSING = np.array([1.0, 0.0, 1.0, 1.0], np.float32)  # magenta, as Blender shows a missing image
DATA_SPACES = {"Non-Color", "Raw", "data"}
LINEAR_SPACES = {"Linear", "scene_linear"}
MAX_SIZE = 2048


class ImageCache:
    """Pyramids of the images of one conversion, each read and reduced once."""

    def __init__(self, report, max_size: int = MAX_SIZE, frame: int | None = None):
        self.report, self.max_size = report, max_size
        self.frame = bpy.context.scene.frame_current if frame is None else frame
        self._pyramids: dict[tuple, Pyramid] = {}

    def pyramid(self, image, owner: str, straight: bool = False, user=None, tile: int | None = None) -> Pyramid:
        """Pyramid of `image`; one magenta texel, reported under `owner`, when it has no pixels.

        straight: colours are not multiplied with alpha. user: the node's ImageUser, for sequences.
        """
        frame = frame_number(user, self.frame) if user and image and image.source == "SEQUENCE" else None
        key = image.as_pointer() if image else 0, straight, frame, tile
        if key not in self._pyramids:
            self._pyramids[key] = self._load(image, owner, straight, frame, tile)
        return self._pyramids[key]

    def _load(self, image, owner, straight, frame, tile) -> Pyramid:
        if image is None:
            self.report.approximated(owner, "an image texture node holds no image: magenta is used")
            return Pyramid(MISSING.reshape(1, 1, 4))
        pixels = stored_pixels(image, frame, tile)
        if pixels is None:
            which = f", frame {frame}" if frame is not None else f", tile {tile}" if tile is not None else ""
            self.report.approximated(owner, f'image "{image.name}"{which} cannot be read from "{image.filepath}": '
                                            "magenta is used; relink the file")
            return Pyramid(MISSING.reshape(1, 1, 4))
        pyramid = _as_cycles(image, pixels, straight)
        rows, columns = (min(size, self.max_size) for size in pyramid.shape)
        return pyramid if (rows, columns) == pyramid.shape else Pyramid(area_resample(pyramid.level(0), rows, columns))


def _as_cycles(image, pixels: np.ndarray, straight: bool) -> Pyramid:
    """Bytes of sRGB are interpolated in its curve, and multiplied with alpha in it; data never are."""
    space, mode = image.colorspace_settings.name, image.alpha_mode
    if mode == "NONE":
        pixels[..., 3] = 1
    associated = mode in ("STRAIGHT", "PREMUL") and space not in DATA_SPACES
    divided = _over_alpha if associated and straight else lambda texels: texels
    if image.is_float or space in DATA_SPACES:
        return Pyramid(pixels, divided)
    is_rec709 = compat.working_space() == "Linear Rec.709"
    curved = space == "sRGB" and is_rec709
    if not curved and not (space in LINEAR_SPACES or space == "Linear Rec.709" and is_rec709):
        pixels[..., :3] = scene_linear(pixels[..., :3], space)
    if associated:
        pixels[..., :3] *= pixels[..., 3:]
    if mode == "PREMUL" and associated and image.source != "GENERATED" and not image.packed_file:
        pixels[..., :3] *= pixels[..., 3:]  # Blender has divided by alpha, Cycles multiplies what is in the file
    return Pyramid(pixels, (lambda texels: _decoded(divided(texels))) if curved else divided)


def _over_alpha(texels: np.ndarray) -> np.ndarray:
    alpha = texels[..., 3:]
    return np.concatenate([texels[..., :3] / np.where(alpha == 0, 1, alpha), alpha], axis=-1)


def _decoded(texels: np.ndarray) -> np.ndarray:
    return np.concatenate([srgb_to_linear(texels[..., :3]), texels[..., 3:]], axis=-1)
