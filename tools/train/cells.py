# SPDX-License-Identifier: GPL-3.0-or-later
"""What the gain map learns from: samples as the rest of a network renders them, small enough to be held in memory."""
from __future__ import annotations

import hashlib
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn import functional as F
from torch.utils.data import DataLoader, Dataset

from renderformer_v2.model.color import HALF_MAX
from renderformer_v2.model.guided.gain_map import cell_side
from renderformer_v2.model.guided.light import SEEN, decode_light, light_cells
from renderformer_v2.model.guided.network import GuidedRenderFormer
from tools.datagen.shards import sample_paths

from . import cache_key
from .errors import SampleError
from .samples import TrainingSample, build_sample, with_latents

CHANNELS = len(SEEN), 3, 3  # what is seen, radiance as it is, and as it should be


def rendered(network: GuidedRenderFormer, sample: TrainingSample) -> Tensor:
    """(V, sum(CHANNELS), h, w) cells of all views of a scene under a network whose gain map changes nothing."""
    guides = sample.view.guides
    raw = network.render_view(network.encode_scene(sample.inputs), sample.view)
    radiance = torch.cat([decode_light(raw, guides)["image"], sample.image], 1)
    return torch.cat([light_cells(raw, guides), F.avg_pool2d(radiance, cell_side(*raw.shape[2:]))], 1)


class CellFiles(Dataset):
    """Of all samples in a folder, made where they are missing or out of date."""

    def __init__(self, data: Path, stored: Path, network: GuidedRenderFormer, mapper):
        self.paths, self.stored, self.network, self.mapper = sample_paths(data), stored, network, mapper
        weights = b"".join(p.detach().numpy().tobytes() for name, p in network.named_parameters()
                           if not name.startswith("gain_map."))
        self.made_by = hashlib.sha256(weights).hexdigest()[:12]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Path | None:
        """The file of one sample; None, and a line that says so, if that cannot be read."""
        torch.set_num_threads(1)
        path = self.paths[index]
        file = self.stored / f"{path.stem}-{self.made_by}-{cache_key.key(path)}.safetensors"
        if not file.is_file():
            try:
                sample = with_latents(build_sample(path), self.mapper)
            except SampleError as error:
                print(f"{error} (left out)", flush=True)
                return None
            with torch.inference_mode():
                cells = rendered(self.network, sample).clamp(-HALF_MAX, HALF_MAX).half()
            save_file({"cells": cells}, file.with_suffix(".tmp"))
            file.with_suffix(".tmp").replace(file)
        return file


def load_cells(files: CellFiles, processes: int) -> list[Tensor]:
    """(V, sum(CHANNELS), h, w) f16 of every sample."""
    files.stored.mkdir(parents=True, exist_ok=True)
    found = []
    for file in DataLoader(files, batch_size=None, num_workers=processes):
        if file is not None:
            found.append(load_file(file)["cells"])
            if len(found) % 50 == 0:
                print(f"{len(found)} of {len(files)} samples", flush=True)
    return found
