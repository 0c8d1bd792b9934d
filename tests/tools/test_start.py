# SPDX-License-Identifier: GPL-3.0-or-later
"""Training that begins with the weights of another network."""
from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file, save_file

from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.weights.checkpoint import save_network
from renderformer_v2.model.weights.presets import rf2_small
from tools.train.errors import TrainingError
from tools.train.network import start_from

TINY = replace(rf2_small(), latent_dim=48, num_layers=1, num_heads=1, dim_feedforward=64, num_register_tokens=2,
               intra_rope_pe_num_freqs=8, view_transformer_latent_dim=48, view_transformer_ffn_hidden_dim=64,
               view_transformer_n_heads=1, dpt_features=8, dpt_out_channels=(8, 8, 8, 8))
KEY = "guidance.bundle_encoder.weight"


@pytest.fixture
def folder(tmp_path):
    save_network(tmp_path, TINY, new_network(TINY).state_dict())
    return tmp_path


def changed(folder, change):
    state = load_file(folder / "model.safetensors")
    change(state)
    (folder / "model.safetensors").unlink()
    save_file(state, folder / "model.safetensors")
    return state


def test_the_same_network_is_taken_over(folder):
    model, stored = new_network(TINY), load_file(folder / "model.safetensors")
    start_from(model, folder)
    for name, p in model.named_parameters():
        assert torch.equal(p, stored[name].float()), name


def test_inputs_that_were_not_there_start_at_zero(folder):
    stored = changed(folder, lambda state: state.update({KEY: state[KEY][:, :100].contiguous()}))
    model = new_network(TINY)
    start_from(model, folder)
    weight = dict(model.named_parameters())[KEY]
    assert torch.equal(weight[:, :100], stored[KEY].float()) and not weight[:, 100:].any()


def test_outputs_that_were_not_there_start_at_zero(folder):
    name = "pixel_decoder.leave.bias"
    stored = changed(folder, lambda state: state.update({name: state[name][:21].contiguous()}))
    model = new_network(TINY)
    start_from(model, folder)
    bias = dict(model.named_parameters())[name]
    assert torch.equal(bias[:21], stored[name].float()) and len(bias) > 21 and not bias[21:].any()


@pytest.mark.parametrize("module", ["kernel_predictor", "pixel_decoder"])
def test_a_module_that_was_not_there_is_kept_as_it_is(folder, module):
    changed(folder, lambda state: [state.pop(name) for name in list(state) if name.startswith(module + ".")])
    model = new_network(TINY)
    before = {name: p.clone() for name, p in getattr(model, module).named_parameters()}
    start_from(model, folder)
    assert before and all(torch.equal(p, before[name]) for name, p in getattr(model, module).named_parameters())


@pytest.mark.parametrize("change, message", [
    (lambda state: state.pop(KEY), f"has no {KEY}"),
    (lambda state: state.pop("kernel_predictor.enter.bias"), "has no kernel_predictor.enter.bias"),
    (lambda state: state.update({KEY: torch.zeros(3, 4)}), r"has shape \(3, 4\)"),
])
def test_another_network_is_refused(folder, change, message):
    changed(folder, change)
    with pytest.raises(TrainingError, match=message):
        start_from(new_network(TINY), folder)
