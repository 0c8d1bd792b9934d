# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture asks of a graphics card's memory, beside what it has: only where PyTorch is loaded already."""
from __future__ import annotations

import sys

from ...model import presets
from ..settings import FrameSettings

PARAMETERS = {True: 11_000_000, False: 270_000_000}  # of guided networks; of published ones with the image encoder


def memory(settings: FrameSettings, tokens: int, pixels: int) -> tuple[int, int] | None:
    """Bytes that are needed, an upper estimate, and that are free; None where no card is used, or nothing tells."""
    if "torch" not in sys.modules:
        return None  # importing it takes seconds
    from ...model.devices import choose_device, free_memory
    from ...model.network.footprint import card_bytes
    from ...model.network.renderformer import KEYS_VALUES_BYTES
    from ...model.precision import choose_precision, has_tensor_float_32
    try:
        device = choose_device(settings.device)
        item = choose_precision(settings.precision, device).itemsize
    except ValueError:
        return None  # the render will say why
    free = free_memory(device)
    if free is None:
        return None
    config = presets.rf2_small() if settings.guided else presets.rf2_200m()
    view_item = item if settings.guided or not has_tensor_float_32(device) else 4
    return card_bytes(config, PARAMETERS[settings.guided], tokens, pixels, (item, view_item), KEYS_VALUES_BYTES), free


def line(found: tuple[int, int] | None) -> str:
    """A sentence for Preflight; "" without a card."""
    if found is None:
        return ""
    needed, free = found
    advice = ": it will work in smaller pieces, more slowly" if needed > free else ""
    return f"Card: at most {needed / 1e9:.1f} GB are needed, {free / 1e9:.1f} GB are free{advice}"
