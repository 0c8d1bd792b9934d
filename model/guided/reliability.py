# SPDX-License-Identifier: GPL-3.0-or-later
"""Where traced light is lost in its noise, while nothing is known against its estimate.

A denoiser makes something of whatever it is given. Of the sky behind a small opening that is so few samples that it
loses shadows, and light, which an estimate has. Means over many pixels still tell whether the estimate is right.
"""
from __future__ import annotations

from torch import Tensor

from ..light.traced_noise import mean_around

REACH = 6         # pixels, in which noise and means are looked for
NOISY = 1.5       # noise over light, from which on more than half of the light is lost
UNEQUAL = 0.3     # how much the estimate may differ from traced light in the mean
DEVIATIONS = 2.0  # of the mean noise, by which it may differ besides
DARK = 0.02       # of the light of a view, whose noise is not seen


def unreliable_share(traced: Tensor, noise: Tensor, estimate: Tensor) -> Tensor:
    """(V, 1, H, W) share of denoised `traced` light that is lost in the `noise` which the denoiser took away.

    All light is (V, 3, H, W), in the exposure of its view.
    """
    traced, noise, estimate = (light.mean(1, keepdim=True) for light in (traced, noise, estimate))
    deviation, light = mean_around(noise.square(), REACH).sqrt(), mean_around(traced, REACH) + DARK
    by_chance = DEVIATIONS * deviation / (2 * REACH + 1)  # in the mean of so many pixels
    difference = mean_around(traced + noise - estimate, REACH) / (UNEQUAL * light + by_chance)
    relative2 = (deviation / light).square()
    return relative2 / (relative2 + NOISY ** 2) / (1 + difference.square())
