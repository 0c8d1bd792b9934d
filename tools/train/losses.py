# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's loss, L1 of the log image plus a small perceptual term (paper, Loss Function); and for the guided network
also the error as a screen shows it.

The paper's perceptual term is LPIPS. It is used when its weights are on this machine (tools/common/lpips.py); otherwise
a stand-in without weights compares structure: SSIM and finite differences over an image pyramid. Both see the log image
divided by log10(2), clamped to [0, 1].
"""
from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional as F

from renderformer_v2.model.guided.exposure import display_encode
from tools.common.lpips import load_lpips

PERCEPTUAL_WEIGHT = 0.05
SHOWN_WEIGHT = 0.25  # of the error on a screen, whose values are about as uniform as perception
SQUARED_WEIGHT = 4.0  # of its square beside its amount: PSNR counts squares
PSNR_WEIGHT = 0.02  # of each view's decibels: those of a picture that is nearly right count as much as others
OTHER_WEIGHT = 0.2  # of all else, whose gradients scenes that are hardly right would rule
BEST_PSNR = 50.0  # decibels from which on a view has no more to gain
PYRAMID_LEVELS = 3
LOBE_WEIGHT = 1.0  # supervision of direct and indirect light per lobe (Cycles' passes), training only


def log_radiance(x: Tensor) -> Tensor:
    """log10(1 + x), and below zero its tangent there, because a clamp would end the gradients of what is negative."""
    return torch.where(x > 0, torch.log10(1 + x.clamp_min(0)), x / math.log(10))


def paper_loss(predicted: Tensor, target: Tensor, perceptual) -> Tensor:
    """(V, 3, H, W) log images, log10(1 + radiance) in network exposure, both."""
    display = lambda y: (y / math.log10(2)).clamp(0, 1)  # noqa: E731
    return (predicted - target).abs().mean() + PERCEPTUAL_WEIGHT * perceptual(display(predicted), display(target))


def image_loss(predicted: Tensor, target: Tensor, perceptual) -> Tensor:
    """`paper_loss` and the error on a screen of (V, 3, H, W) linear radiance in network exposure, both."""
    difference = display_encode(predicted) - display_encode(target)
    decibels = -10 * torch.log10(difference.square().mean((1, 2, 3)) + 10 ** (-BEST_PSNR / 10))
    displayed = SHOWN_WEIGHT * (difference.abs() + SQUARED_WEIGHT * difference.square()).mean()
    return (OTHER_WEIGHT * (paper_loss(log_radiance(predicted), log_radiance(target), perceptual) + displayed)
            + PSNR_WEIGHT * (BEST_PSNR - decibels).mean())


def lobe_loss(light: Tensor, target: Tensor, albedo: Tensor) -> Tensor:
    """L1 of the log of each lobe's light, weighted by the lobe's albedo; all (V, lobes, 3, H, W)."""
    weight = albedo.clamp(0, 1)
    error = (log_radiance(light) - log_radiance(target)).abs()
    return LOBE_WEIGHT * (error * weight).sum() / weight.sum().clamp_min(1.0)


def structure_loss(a: Tensor, b: Tensor) -> Tensor:
    """The stand-in: 1 - SSIM plus L1 of finite differences, mean over the pyramid. Inputs (V, 3, H, W) in [0, 1]."""
    total = a.new_zeros(())
    for level in range(PYRAMID_LEVELS):
        if level:
            a, b = F.avg_pool2d(a, 2), F.avg_pool2d(b, 2)
        total = total + (1 - ssim(a, b)) + sum((_difference(a, axis) - _difference(b, axis)).abs().mean()
                                               for axis in (-1, -2))
    return total / PYRAMID_LEVELS


def ssim(a: Tensor, b: Tensor, window: int = 7) -> Tensor:
    """Mean structural similarity over box windows."""
    mean = lambda x: F.avg_pool2d(x, window, 1)  # noqa: E731
    mu_a, mu_b = mean(a), mean(b)
    var_a, var_b = mean(a * a) - mu_a**2, mean(b * b) - mu_b**2
    covariance = mean(a * b) - mu_a * mu_b
    c1, c2 = 0.01**2, 0.03**2
    similarity = (2 * mu_a * mu_b + c1) * (2 * covariance + c2)
    return (similarity / ((mu_a**2 + mu_b**2 + c1) * (var_a + var_b + c2))).mean()


def _difference(x: Tensor, axis: int) -> Tensor:
    return torch.diff(x, dim=axis)


def perceptual_term(device: torch.device, backbone: str = "alex"):
    """LPIPS by one of lpips.BACKBONES on `device` when its weights are on this machine, else `structure_loss`."""
    network = load_lpips(backbone)
    if network is None:
        return structure_loss
    network.to(device)
    return lambda a, b: network(a, b).mean()
