# SPDX-License-Identifier: GPL-3.0-or-later
"""The Qwen-Image VAE's encoder, which makes texture and environment latents (docs/scene-input.md 4.5, 7.4)."""
from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from pathlib import Path

import torch
from torch import nn
from torch.nn import functional as F

from ..compute.inference import current_pieces
from ..compute.threads import begin_import, finish
from ..errors import CheckpointError
from ..progress import report
from ..weights.checkpoint import load_weights
from ..weights.files import checkpoint_errors, read_json, require

BATCH = 256
BATCH_CPU = 64         # with fewer, the layers of 4x4 pixels are slower; the batch does not change the result
CACHE_BYTES = 1 << 28  # of latents cached for the next scene
SAMPLES = 256          # of 4 kB each of the weights, whose hash identifies them
SMALLEST = 1e-24       # square of the least norm by which diffusers divides
CLASS = "AutoencoderKLQwenImage"


@checkpoint_errors()
def find_vae(bundle: Path) -> Path:
    """`vae` inside the bundle, or in a folder `Qwen-Image` beside it. Raises CheckpointError when there is neither."""
    folders = [bundle / "vae", bundle.absolute().parent / "Qwen-Image" / "vae"]
    for folder in folders:
        if folder.is_dir():
            return folder
    raise CheckpointError(f"the published weights need the VAE of Qwen/Qwen-Image: copy its folder vae to "
                          f"{folders[0]}, or to {folders[1]}")


class ImageEncoder:
    """Images -> posterior means, without the latent normalisation; the same image is encoded once.

    The network is read at the first call, because importing diffusers takes seconds.
    """

    def __init__(self, folder: Path, device: torch.device | str = "cpu", dtype: torch.dtype | None = None):
        """folder: config.json and diffusion_pytorch_model.safetensors, as diffusers writes them.

        dtype: of a render; a processor encodes in bfloat16 with it, all else in float32 as in training.

        Raises CheckpointError when diffusers is missing, or the folder is not a complete Qwen-Image VAE.
        """
        if importlib.util.find_spec("diffusers") is None:
            raise CheckpointError("diffusers is needed to encode textures for the published weights: install the "
                                  "packages for the published weights in the add-on's preferences, or run "
                                  "`pip install diffusers huggingface_hub`")
        self.config = read_json(require(folder, "config.json"))
        if self.config.get("_class_name", CLASS) != CLASS:
            raise CheckpointError(f"{folder / 'config.json'} describes {self.config['_class_name']}, not {CLASS}")
        self.channels = self.config.get("z_dim", 16)
        self.file, self.device = require(folder, "diffusion_pytorch_model.safetensors"), torch.device(device)
        half = dtype == torch.bfloat16 and self.device.type == "cpu"
        self.dtype = torch.bfloat16 if half else torch.float32
        self._network: OneFrameEncoder | None = None
        self._latents: dict[bytes, torch.Tensor] = {}
        self._latent_bytes = 0

    @property
    @checkpoint_errors()
    def identity(self) -> bytes:
        """A hash of weights and precision; reads a small part of the file."""
        digest = hashlib.blake2b(f"{sorted(self.config.items())}{self.dtype}".encode(), digest_size=16)
        with self.file.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            for i in range(SAMPLES):
                stream.seek(size * i // SAMPLES)
                digest.update(stream.read(4096))
        return digest.digest() + size.to_bytes(8, "little")

    def __call__(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) of any float type, on the CPU -> (B, 16, H/8, W/8) float32 on the CPU."""
        keys = [hashlib.blake2b(image.numpy().tobytes() + repr(image.shape).encode(), digest_size=16).digest()
                for image in images.contiguous()]
        new = {key: i for i, key in enumerate(keys) if key not in self._latents}
        if new:
            latents = self._encode(images[list(new.values())])
            self._latents.update(zip(new, latents))
            self._latent_bytes += latents.nbytes
        result = torch.stack([self._latents[key] for key in keys])
        if self._latent_bytes > CACHE_BYTES:
            self._latents, self._latent_bytes = {}, 0
        return result

    def _encode(self, images: torch.Tensor) -> torch.Tensor:
        if self._network is None:
            kind = finish(begin_import(vae_class))
            network = OneFrameEncoder(load_vae(kind, self.config, self.file))
            self._network = network.to(self.device, self.dtype, memory_format=torch.channels_last)
        tile = images.shape[-1] * images.shape[-2]
        size = max(1, current_pieces().limit(BATCH if self.device.type == "cuda" else BATCH_CPU) * 32 * 32 // tile)
        return torch.cat([self._network(batch.to(self.device, self.dtype)).float().cpu()
                          for batch in images.split(size)])


def vae_class() -> type[nn.Module]:
    """diffusers' AutoencoderKLQwenImage; the import takes 3 s.

    It would load Triton, whose LLVM crashes in a Blender where a graphics driver has loaded another, and which is of no
    use here.
    """
    hides = "bpy" in sys.modules and "triton" not in sys.modules
    if hides:
        sys.modules["triton"] = None
    try:
        from diffusers import AutoencoderKLQwenImage
    finally:
        if hides:
            del sys.modules["triton"]
    return AutoencoderKLQwenImage


def load_vae(kind: type[nn.Module], config: dict, file: Path) -> nn.Module:
    """A `kind` in float32, read strictly. Raises CheckpointError."""
    try:
        with torch.device("meta"):
            vae = kind.from_config(config)
    except (TypeError, ValueError) as error:
        raise CheckpointError(f"{file.parent / 'config.json'} does not fit {CLASS}: {error}") from error
    return load_weights(vae, file)


class OneFrameEncoder(nn.Module):
    """The VAE's encoder for videos of one frame, at less than a third of the cost in the same precision.

    Its convolutions are causal in time: before the first frame they see zeros, so only their last tap counts. Channels
    come last in memory, for convolutions and norms.
    """

    def __init__(self, vae: nn.Module):
        super().__init__()
        self.encoder, self.quant_conv = vae.encoder, vae.quant_conv
        for module in list(self.modules()):
            for name, child in module.named_children():
                if isinstance(child, nn.Conv3d):
                    setattr(module, name, LastTap(child))
                elif type(child).__name__ == "QwenImageRMS_norm":
                    setattr(module, name, ChannelNorm(child))
        for module in self.modules():
            if not any(module.children()):
                module.register_forward_pre_hook(lambda module, inputs: report())

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        images = images.contiguous(memory_format=torch.channels_last)
        moments = self.quant_conv(self.encoder(images[:, :, None]))
        return moments[:, : moments.shape[1] // 2, 0]


class LastTap(nn.Module):
    """A causal 3-D convolution on a video of one frame."""

    def __init__(self, convolution: nn.Conv3d):
        super().__init__()
        self.weight, self.bias = nn.Parameter(convolution.weight[:, :, -1].contiguous(), False), convolution.bias

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return F.conv2d(x[:, :, 0], self.weight, self.bias, padding=self.weight.shape[-1] // 2)[:, :, None]


class ChannelNorm(nn.Module):
    """The VAE's norm of the channels of (B, C, ...) at each place; unlike other norms it has no eps."""

    def __init__(self, norm: nn.Module):
        super().__init__()
        self.gamma = nn.Parameter(norm.gamma.flatten(), False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if x.device.type != "cpu":
            return F.rms_norm(x.movedim(1, -1), self.gamma.shape, self.gamma, SMALLEST).movedim(-1, 1)
        # For CPUs PyTorch has no kernel of it, and what it does instead takes as long as the convolutions.
        last = x.movedim(1, -1)
        length = torch.linalg.vector_norm(last, dim=-1, keepdim=True, dtype=torch.float32).clamp_min(SMALLEST ** 0.5)
        normal = last * (len(self.gamma) ** 0.5 / length).to(x.dtype)
        return normal.mul_(self.gamma).movedim(-1, 1)
