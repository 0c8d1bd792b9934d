# SPDX-License-Identifier: GPL-3.0-or-later
"""NVIDIA cards that PyTorch is told of on a machine without one: all questions are answered, and nothing runs there."""
from types import SimpleNamespace

import torch

CUDA_13 = ["sm_75", "sm_80", "sm_86", "sm_90", "sm_100", "sm_120", "compute_120"]


def describe(monkeypatch, *cards, builds=CUDA_13, cuda="13.0", driver=13000, free=8e9) -> None:
    """Cards (name, capability, GiB), for a PyTorch with programs for these `builds`; free: bytes of each."""
    at = lambda device: cards[device if isinstance(device, int) else device.index or 0]  # noqa: E731
    monkeypatch.setattr(torch.version, "cuda", cuda)
    monkeypatch.setattr(torch._C, "_cuda_getDriverVersion", lambda: driver, raising=False)
    answers = {
        "is_available": lambda: bool(cards), "device_count": lambda: len(cards), "get_arch_list": lambda: builds,
        "get_device_name": lambda device: at(device)[0], "get_device_capability": lambda device: at(device)[1],
        "get_device_properties": lambda device: SimpleNamespace(total_memory=at(device)[2] << 30),
        "mem_get_info": lambda device: (int(free), at(device)[2] << 30),
        "memory_reserved": lambda device: 0, "memory_allocated": lambda device: 0,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(torch.cuda, name, answer)
