# SPDX-License-Identifier: GPL-3.0-or-later
"""Muon's steps are those of PyTorch's, and a training with it goes on where it was."""
import pytest
import torch
from torch import nn

from tools.train.muon import Muon
from tools.train.state import TrainingState

SHAPES = (6, 4), (6, 4), (4, 9)


@pytest.mark.skipif(not hasattr(torch.optim, "Muon"), reason="PyTorch has Muon from 2.9 on")
def test_steps_are_those_of_pytorch():
    torch.manual_seed(0)
    ours = [nn.Parameter(torch.randn(shape)) for shape in SHAPES]
    theirs = [nn.Parameter(p.detach().clone()) for p in ours]
    optimizers = Muon(ours, 0.01, 0.05), torch.optim.Muon(theirs, 0.01, 0.05, adjust_lr_fn="match_rms_adamw")
    for _ in range(5):
        for p, q in zip(ours, theirs):
            p.grad = torch.randn_like(p)
            q.grad = p.grad.clone()
        for optimizer in optimizers:
            optimizer.step()
    for p, q in zip(ours, theirs):
        torch.testing.assert_close(p, q, atol=2e-4, rtol=1e-3)


def make(*muon: str) -> TrainingState:
    torch.manual_seed(1)
    model = nn.Sequential(nn.Linear(3, 5), nn.SiLU(), nn.Linear(5, 2))
    return TrainingState(model, 0.01, 0.05, 0.9, muon)


def step(state: TrainingState, x: torch.Tensor) -> None:
    state.model(x).square().sum().backward()
    assert state.advance(0.01, 1.0)


def test_a_training_may_go_on_with_other_optimisers(tmp_path):
    first, second = make(), make("2.")
    x = torch.randn(4, 3)
    step(first, x)
    first.save(tmp_path / "state.safetensors")
    assert second.resume(tmp_path / "state.safetensors")
    matrices = [second.model[0].weight, second.model[2].weight]
    assert [bool(second.optimizer_of[p].state.get(p)) for p in matrices] == [True, False]
    step(second, x)


def test_a_resumed_training_steps_as_one_that_was_not_interrupted(tmp_path):
    first, second = make("2."), make("2.")
    assert [type(optimizer) for optimizer in first.optimizers] == [torch.optim.AdamW, Muon]
    x = torch.randn(4, 3)
    step(first, x)
    first.save(tmp_path / "state.safetensors")
    assert second.resume(tmp_path / "state.safetensors")
    step(first, x)
    step(second, x)
    for p, q in zip(first.model.parameters(), second.model.parameters()):
        assert torch.equal(p, q)
