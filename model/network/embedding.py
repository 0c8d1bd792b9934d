# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene primitives -> tokens: triangles, volume cells, environment (docs/network.md 4)."""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from ..compute.inference import chunked
from ..environment import direction_map
from .config import ENVIRONMENT_GRID, ModelConfig
from .inputs import EnvironmentInputs, NetworkInputs, VolumeInputs
from .layers import Linear, RMSNorm, learned_token, nerf_encode, nerf_width
from .sequence import centroids


class VolumeEncoder(nn.Module):
    """Sum of five small perceptrons and a learned token (docs/network.md 4.2)."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        d = config.latent_dim
        self.vol_token = learned_token(1, d)
        self.density_encoder = _perceptron(config.volume_density_input_dim, d, d)
        self.rotation_encoder = _perceptron(3, d // 4, d)
        self.scale_encoder = _perceptron(3, d // 4, d)
        self.scattering_encoder = _perceptron(3, d // 4, d)
        self.absorption_encoder = _perceptron(3, d // 4, d)

    def forward(self, volumes: VolumeInputs) -> torch.Tensor:
        """M cells -> (M, D) float32."""
        parts = (self.density_encoder(volumes.density), self.rotation_encoder(volumes.rotation),
                 self.scale_encoder(volumes.scale), self.scattering_encoder(volumes.scattering),
                 self.absorption_encoder(volumes.absorption))
        return sum(part.float() for part in parts) + self.vol_token.float()[0]


class SceneEmbedding(nn.Module):
    """All token embeddings. RenderFormer derives from it because published checkpoints keep these keys at the root."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        d, eps = config.latent_dim, config.embed_norm_eps
        self.tri_token = learned_token(1, d)
        self.reg_tokens = learned_token(config.num_register_tokens, d)
        self.intra_tri_pos_emb_proj = Linear(nerf_width(9, config.vertex_pe_num_freqs), d)
        self.intra_tri_pos_emb_norm = RMSNorm(d, eps)
        self.vn_encoding_proj = Linear(nerf_width(9, config.vn_pe_num_freqs), d)
        self.vn_encoder_norm = RMSNorm(d, eps)
        self.texture_encoder = Linear(config.texture_channels * config.texture_encode_patch_size ** 2, d)
        self.texture_encoder_norm = RMSNorm(d, eps)
        self.light_strength_encoder = Linear(3, d)
        self.light_strength_encoder_norm = RMSNorm(d, eps)
        if config.use_env_lighting:
            self.env_proj = Linear(config.envmap_latent_channels * config.envmap_latent_patch_size ** 2, d)
            self.env_proj_norm = RMSNorm(d, eps)
            self.ray_dir_proj = Linear(3 * config.envmap_ray_dir_map_patch_size ** 2, d)
            self.ray_dir_norm = RMSNorm(d, eps)
            self.env_light_strength_encoder = Linear(1, d)
            self.env_light_strength_encoder_norm = RMSNorm(d, eps)
        if config.use_volumes:
            self.volume_encoder = VolumeEncoder(config)

    def embed_triangles(self, inputs: NetworkInputs) -> torch.Tensor:
        """N triangles -> (N, D) float32 (docs/network.md 4.1)."""
        textures = self.embed_textures(inputs.texture)
        lights, light_index = self.embed_light(inputs.light)

        def embed(triangles, normals, texture_index, light_index):
            tokens = self.embed_shape(triangles) + self.tri_token.float()[0]
            tokens = tokens + (F.embedding(texture_index, textures) + F.embedding(light_index, lights))
            return tokens + self.embed_normals(normals)

        return chunked(embed, inputs.triangles, inputs.normals, inputs.texture_index, light_index)

    def embed_shape(self, triangles: torch.Tensor) -> torch.Tensor:
        """Corners relative to their centroid."""
        offsets = (triangles - centroids(triangles)[:, None]).flatten(1)
        encoded = nerf_encode(offsets, self.config.vertex_pe_num_freqs)
        return self.intra_tri_pos_emb_norm(self.intra_tri_pos_emb_proj(encoded))

    def embed_normals(self, normals: torch.Tensor) -> torch.Tensor:
        encoded = nerf_encode(normals.flatten(1), self.config.vn_pe_num_freqs)
        return self.vn_encoder_norm(self.vn_encoding_proj(encoded))

    def embed_textures(self, texture: torch.Tensor) -> torch.Tensor:
        """(T, C, q, q) latents -> (T, D)."""
        texture = resize_texture(texture, self.config.texture_encode_patch_size)
        return chunked(lambda t: self.texture_encoder_norm(self.texture_encoder(t)), texture.flatten(1))

    def embed_light(self, light: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(N, 3) encoded radiance -> (k + 1, D) embeddings, and (N,) each triangle's row; dark ones share row 0."""
        shines = (light != 0).any(dim=-1)
        rows = torch.cat([light.new_zeros(1, 3), light[shines]])
        embedded = self.light_strength_encoder_norm(self.light_strength_encoder(rows))
        return embedded, torch.where(shines, shines.cumsum(0), 0)

    def embed_environment(self, environment: EnvironmentInputs) -> torch.Tensor:
        """LDR and HDR panorama -> (64, D) float32 (docs/network.md 4.3); (B, 64, D) of B environments in one."""
        latents = torch.stack([environment.ldr, environment.hdr], dim=-4).float()
        content = patches(latents.flatten(0, -4), self.config.envmap_latent_patch_size)
        content = self.env_proj_norm(self.env_proj(content)).unflatten(0, latents.shape[:-3])
        side = self.config.envmap_ray_dir_map_patch_size
        rows, columns = ENVIRONMENT_GRID
        directions = torch.from_numpy(direction_map(rows * side, columns * side)).to(content.device)
        direction = self.ray_dir_norm(self.ray_dir_proj(patches(directions.permute(2, 0, 1)[None], side)))
        strength = self.env_light_strength_encoder(environment.strength[..., None, None, :])
        strength = self.env_light_strength_encoder_norm(strength)
        return (content + direction + strength).flatten(-3, -2)


def patches(image: torch.Tensor, side: int) -> torch.Tensor:
    """(B, C, H, W) -> (B, H W / side^2, C side^2): patches row-major, each flattened (channel, row, column)."""
    return F.unfold(image, side, stride=side).transpose(1, 2)


def resize_texture(texture: torch.Tensor, side: int) -> torch.Tensor:
    """(T, C, q, q) -> (T, C, side, side): area average down, antialiased bilinear up (docs/network.md 2)."""
    texture = texture.float()
    if texture.shape[-1] > side:
        return F.interpolate(texture, size=(side, side), mode="area")
    if texture.shape[-1] < side:
        return F.interpolate(texture, size=(side, side), mode="bilinear", antialias=True, align_corners=False)
    return texture


def _perceptron(width: int, hidden: int, out: int) -> nn.Sequential:
    return nn.Sequential(Linear(width, hidden), nn.GELU(), Linear(hidden, out))
