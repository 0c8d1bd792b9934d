# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposures by what a view shows: it may look at a dim room beside a bright one."""
from __future__ import annotations

import torch
from torch import Tensor

KEY = 0.18                # log average of what a view sees, in its exposure
LEAST_OF_MEAN = 0.01      # added to every pixel before its logarithm, times the mean


def key_exposure(luminance: Tensor) -> Tensor:
    """Factor that puts the log average of (P,) at KEY (Reinhard et al. 2002); 1 where all is dark."""
    mean = luminance.mean() if len(luminance) else luminance.new_zeros(())
    average = (luminance + LEAST_OF_MEAN * mean).log().mean().exp() if mean > 0 else mean
    return torch.where(average > 0, KEY / average.clamp_min(1e-20), 1.0)
