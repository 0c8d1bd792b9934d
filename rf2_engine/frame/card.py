# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture asks of a graphics card's memory, beside what it has."""
from __future__ import annotations

import sys

from ...model.scene import RenderScene
from ...model.weights import presets
from ..convert.data.report import Report
from ..runtime import model_cache
from ..settings import FrameSettings
from ..setup import importing, wheels

PARAMETERS = {True: 11_000_000, False: 208_000_000}  # of guided networks; of published ones without the image encoder
IMAGE_ENCODER = 78_500_000  # bytes; it stays in float32 on a card


def length(given: RenderScene, settings: FrameSettings) -> int:
    """Of the token sequence; given: the scene as its weights are told it (trained.py)."""
    config = presets.rf2_small() if settings.guided else presets.rf2_200m()
    lights = int(given.is_light.sum())
    return config.sequence_length(lights, len(given) - lights + len(given.volumes or ()))


def memory(settings: FrameSettings, tokens: int, pixels: int) -> tuple[int, int] | None:
    """Bytes that are needed, an upper estimate, and that are free; None where no card is used, or nothing tells.

    What a loaded network takes counts as free: it is among what is needed.
    """
    if "torch" not in sys.modules:
        if settings.device == "cpu" or not wheels.has_nvidia_driver():
            return None  # importing it takes seconds
        importing.import_packages()
    from ...model.compute.devices import choose_device, free_memory
    from ...model.compute.precision import choose_precision, has_tensor_float_32
    from ...model.network.memory_estimate import card_bytes
    from ...model.network.renderformer import KEYS_VALUES_BYTES
    try:
        device = choose_device(settings.device)
        item = choose_precision(settings.precision, device).itemsize
    except ValueError:
        return None  # the render will say why
    free = free_memory(device, with_ours=model_cache.is_loaded())
    if free is None:
        return None
    config = presets.rf2_small() if settings.guided else presets.rf2_200m()
    view_item = item if settings.guided or not has_tensor_float_32(device) else 4
    needed = card_bytes(config, PARAMETERS[settings.guided], tokens, pixels, (item, view_item), KEYS_VALUES_BYTES)
    return needed + (0 if settings.guided else IMAGE_ENCODER), free


def warn(settings: FrameSettings, given: RenderScene, pixels: int, report: Report) -> None:
    """Say before the network begins that the card may be too small for it. To be called when PyTorch is there."""
    if (found := memory(settings, length(given, settings), pixels)) and found[0] > found[1]:
        report.approximated("Device", line(found))


def line(found: tuple[int, int] | None) -> str:
    """A sentence for Preflight; "" without a card."""
    if found is None:
        return ""
    needed, free = found
    advice = ": if that is too little, it works in smaller pieces, more slowly" if needed > free else ""
    return f"Card: at most {needed / 1e9:.1f} GB are needed, {free / 1e9:.1f} GB are free{advice}"
