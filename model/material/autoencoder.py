# SPDX-License-Identifier: GPL-3.0-or-later
"""Autoencoder of rendered material spheres with a 9-D bottleneck (docs/scene-input.md 3.6, docs/network.md 13)."""
from __future__ import annotations

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F


def log10_1p(radiance: torch.Tensor) -> torch.Tensor:
    """Linear RGB -> the autoencoder's space."""
    return torch.log10(radiance + 1)


def inverse_log10_1p(log_radiance: torch.Tensor) -> torch.Tensor:
    """The autoencoder's space -> linear RGB."""
    return torch.pow(10.0, log_radiance) - 1


class ResidualBlock(nn.Module):
    """silu(gn2(conv2(silu(gn1(conv1 x)))) + x)."""

    def __init__(self, width: int, groups: int):
        super().__init__()
        self.conv1, self.gn1 = nn.Conv2d(width, width, 3, padding=1), nn.GroupNorm(groups, width)
        self.conv2, self.gn2 = nn.Conv2d(width, width, 3, padding=1), nn.GroupNorm(groups, width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return F.silu(self.gn2(self.conv2(F.silu(self.gn1(self.conv1(x))))) + x)


class MaterialAutoencoder(nn.Module):
    """3 x S x S <-> latent. Three stages bring S to S / 8, the residual trunk works there, further stages end at 1 x 1.

    widths: channels at S / 2, S / 4 and S / 8; image_size S is a power of two of at least 16. The defaults are the
    published sizes.
    """

    def __init__(self, latent_dim: int = 9, image_channels: int = 3, image_size: int = 256,
                 widths: tuple[int, int, int] = (1024, 512, 256), residual_blocks: int = 8, groups: int = 32):
        super().__init__()
        if image_size < 16 or image_size & (image_size - 1):
            raise ValueError(f"image_size must be a power of two of at least 16, not {image_size}")
        first, second, trunk = widths
        stages = image_size.bit_length() - 5  # from S / 8 down to 2 x 2

        def down(a: int, b: int) -> list[nn.Module]:
            return [nn.Conv2d(a, b, 3, stride=2, padding=1), nn.GroupNorm(groups, b), nn.SiLU()]

        def up(a: int, b: int) -> list[nn.Module]:
            return [_transposed(a, b), nn.GroupNorm(groups, b), nn.SiLU()]

        self.encoder_initial = nn.Sequential(*down(image_channels, first))
        self.encoder_mid = nn.Sequential(*down(first, second), *down(second, trunk))
        self.encoder_residual = nn.Sequential(*(ResidualBlock(trunk, groups) for _ in range(residual_blocks)))
        self.encoder_final = nn.Sequential(*(layer for _ in range(stages) for layer in down(trunk, trunk)),
                                           nn.Conv2d(trunk, trunk, 2), nn.GroupNorm(groups, trunk), nn.SiLU())
        self.latent_proj = nn.Linear(trunk, latent_dim)
        self.decoder_proj = nn.Linear(latent_dim, trunk)
        self.decoder_initial = nn.Sequential(
            nn.ConvTranspose2d(trunk, trunk, 2), nn.GroupNorm(groups, trunk), nn.SiLU(),
            *(layer for _ in range(stages) for layer in up(trunk, trunk)))
        self.decoder_residual = nn.Sequential(*(ResidualBlock(trunk, groups) for _ in range(residual_blocks)))
        self.decoder_final = nn.Sequential(*up(trunk, second), *up(second, first), _transposed(first, image_channels))

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, S, S) in log10_1p space -> (B, latent_dim) in (-1, 1)."""
        x = self.encoder_residual(self.encoder_mid(self.encoder_initial(images)))
        return torch.tanh(self.latent_proj(self.encoder_final(x).flatten(1)))

    def decode(self, latents: torch.Tensor) -> torch.Tensor:
        """(B, latent_dim) -> (B, 3, S, S) in log10_1p space, (0, 1)."""
        x = self.decoder_initial(self.decoder_proj(latents)[..., None, None])
        return torch.sigmoid(self.decoder_final(self.decoder_residual(x)))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return self.decode(self.encode(images))


def encode_picture(model: MaterialAutoencoder, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of a sphere (S, S, 3) f32 linear radiance: its latent (9,) f32, and what the model makes of that (S, S, 3) f32.
    """
    image = log10_1p(torch.from_numpy(np.ascontiguousarray(picture))).clamp(0, 1).movedim(-1, 0)[None]
    with torch.inference_mode():
        latent = model.encode(image)
        decoded = inverse_log10_1p(model.decode(latent))
    return latent[0].numpy(), decoded[0].movedim(0, -1).numpy()


def _transposed(a: int, b: int) -> nn.ConvTranspose2d:
    return nn.ConvTranspose2d(a, b, 3, stride=2, padding=1, output_padding=1)
