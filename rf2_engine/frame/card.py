# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of a graphics card that a picture needs, and that is free."""
from __future__ import annotations

import sys

from ...model.scene import RenderScene
from ...model.weights import presets
from ..convert.data.report import Report
from ..runtime import model_cache
from ..settings import FrameSettings, Network
from ..setup import importing, wheels

PUBLISHED_PARAMETERS = 208_000_000  # without the image encoder
IMAGE_ENCODER = 78_500_000          # bytes; it stays in float32 on a card
GUIDED_WEIGHTS = 1_000_000          # bytes
GUIDED_PIXEL = 320                  # bytes: guides, and the light of each lobe, for every pixel of the picture
GUIDED_WORK = 1_500_000_000         # bytes: light of a band of the picture, patches of surfaces and what they exchange


def count_tokens(scene: RenderScene, settings: FrameSettings) -> int:
    """Length of the token sequence of a scene as its weights are given it (published_scene.py)."""
    config = presets.rf2_200m() if settings.network is Network.PUBLISHED else presets.rf2_small()
    lights = int(scene.is_light.sum())
    return config.sequence_length(lights, len(scene) - lights + len(scene.volumes or ()))


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
        if free is None:
            return None
        if settings.network is Network.PUBLISHED:
            return _published_bytes(settings, device, tokens, pixels), free
    except ValueError:
        return None  # the render will say why
    return GUIDED_WEIGHTS + GUIDED_WORK + GUIDED_PIXEL * pixels, free


def _published_bytes(settings: FrameSettings, device, tokens: int, pixels: int) -> int:
    from ...model.compute.precision import choose_precision, has_tensor_float_32
    from ...model.network.memory_estimate import card_bytes
    from ...model.network.renderformer import KEYS_VALUES_BYTES
    item = choose_precision(settings.precision, device).itemsize
    view_item = 4 if has_tensor_float_32(device) else item
    return IMAGE_ENCODER + card_bytes(presets.rf2_200m(), PUBLISHED_PARAMETERS, tokens, pixels, (item, view_item),
                                      KEYS_VALUES_BYTES)


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
    return f"Card: at most {needed / 1e9:.1f} GB are needed, {free / 1e9:.1f} GB are free{advice}"
