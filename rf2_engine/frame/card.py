# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of a graphics card that a picture needs, and that is free."""
from __future__ import annotations

import sys

from ...model.errors import CheckpointError
from ...model.network.config import ModelConfig
from ...model.scene import RenderScene
from ...model.weights import presets
from ...model.weights.files import described
from ..convert.data.report import Report
from ..frame_settings import FrameSettings, Network
from ..runtime import model_cache
from ..setup import importing, wheels

PUBLISHED_PARAMETERS = 208_000_000  # without the image encoder
IMAGE_ENCODER = 78_500_000          # bytes; it stays in float32 on a card
GUIDED_PIXEL = 720                  # bytes: guides, light of each lobe, decoded channels, of every pixel
GUIDED_BAND = 600_000_000           # bytes: patches, and light of the pixels that are computed at once
GUIDED_PARAMETERS = 7_200_000


def count_tokens(scene: RenderScene, settings: FrameSettings) -> int:
    """Length of the token sequence of a scene, which published_scene.py has prepared for its weights; 0 without one.

    Raises CheckpointError for weights that cannot be read.
    """
    if not settings.has_tokens:
        return 0
    lights = int(scene.is_light.sum())
    return _config(settings).sequence_length(lights, len(scene) - lights + len(scene.volumes or ()))


def memory(settings: FrameSettings, tokens: int, pixels: int) -> tuple[int, int] | None:
    """Bytes that a picture needs, an upper estimate, and that are free; None without a card, or if nothing says so.

    What a loaded network takes counts as free: it is among what is needed.
    """
    if "torch" not in sys.modules:
        if settings.device == "cpu" or not wheels.has_nvidia_driver():
            return None  # importing it takes seconds
        importing.import_packages()
    from ...model.compute.devices import choose_device, free_memory
    try:
        device = choose_device(settings.device)
        free = free_memory(device, with_ours=model_cache.is_loaded())
        return None if free is None else (_needed(settings, device, tokens, pixels), free)
    except (CheckpointError, ValueError):
        return None  # the render will say why


def _needed(settings: FrameSettings, device, tokens: int, pixels: int) -> int:
    from ...model.compute.precision import choose_precision, has_tensor_float_32
    from ...model.network.memory_estimate import estimate_card_bytes
    from ...model.network.renderformer import KEYS_VALUES_BYTES
    item = choose_precision(settings.precision, device).itemsize
    if settings.network is Network.PUBLISHED:
        view_item = 4 if has_tensor_float_32(device) else item
        return IMAGE_ENCODER + estimate_card_bytes(presets.rf2_200m(), PUBLISHED_PARAMETERS, tokens, pixels,
                                                   (item, view_item), KEYS_VALUES_BYTES)
    return GUIDED_BAND + GUIDED_PIXEL * pixels + estimate_card_bytes(
        _config(settings), GUIDED_PARAMETERS, tokens, pixels, (item, item), KEYS_VALUES_BYTES)


def _config(settings: FrameSettings) -> ModelConfig:
    if settings.network is Network.PUBLISHED:
        return presets.rf2_200m()
    return ModelConfig.from_dict(described(presets.weights_folder(settings.weights)))


def warn(settings: FrameSettings, scene: RenderScene, pixels: int, report: Report) -> None:
    """Report, before the network begins, that the card may be too small for it. To be called when PyTorch is there."""
    estimate = memory(settings, count_tokens(scene, settings), pixels)
    if estimate and estimate[0] > estimate[1]:
        report.approximated("Device", describe(estimate))


def describe(estimate: tuple[int, int] | None) -> str:
    """A sentence for Preflight about what `memory` returned; "" without a card."""
    if estimate is None:
        return ""
    needed, free = estimate
    advice = ": if that is too little, it works in smaller pieces, more slowly" if needed > free else ""
    return f"GPU: at most {needed / 1e9:.1f} GB are needed, {free / 1e9:.1f} GB are free{advice}"
