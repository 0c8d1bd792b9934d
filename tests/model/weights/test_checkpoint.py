# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights on disk: what loads, and what is refused with which words."""
import json

import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file

from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.material.mappers import MAPPERS
from renderformer_v2.model.published.bundle import Bundle
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.checkpoint import save_network
from tools.parity.cases import with_recipe_weights
from tools.train.new_bundle import published_mapping


@pytest.fixture
def saved(tmp_path, tiny_config, tiny_network):
    save_network(tmp_path / "weights", tiny_config, tiny_network.state_dict())
    return tmp_path / "weights"


@pytest.fixture
def bundle(tmp_path, tiny_config, tiny_network):
    """A published bundle in miniature, stored in half precision."""
    folder = tmp_path / "bundle"
    model_config = published_mapping(tiny_config)
    for name in ("transformer_512", "transformer_2048"):
        (folder / name).mkdir(parents=True)
        config = {"model_config": model_config, "trainer_config": {"learn_ldr": False}, "dataset_config": {}}
        (folder / name / "config.yaml").write_text(yaml.safe_dump(config))
        save_file({k: v.half().contiguous() for k, v in tiny_network.state_dict().items()},
                  folder / name / "model.safetensors")
    mapper = with_recipe_weights(MAPPERS["metallic_mapper"](hidden_dim=16, num_layers=2))
    (folder / "metallic_mapper").mkdir()
    (folder / "metallic_mapper" / "config.json").write_text(
        json.dumps({"hidden_dim": 16, "num_layers": 2, "latent_dim": 9}))
    save_file(mapper.state_dict(), folder / "metallic_mapper" / "model.safetensors")
    return folder


@torch.no_grad()
def test_saved_network_comes_back(saved, tiny_network, tiny_inputs, rays):
    loaded = load_network(saved)
    assert loaded.config == tiny_network.config
    assert torch.equal(loaded.transformer.rope_emb.freqs, tiny_network.transformer.rope_emb.freqs)
    torch.testing.assert_close(loaded(tiny_inputs, rays), tiny_network(tiny_inputs, rays), atol=5e-3, rtol=0)


def test_bundle_chooses_the_transformer_by_resolution(bundle, tiny_network):
    (bundle / "transformer_2048" / "model.safetensors").unlink()
    network = Bundle(bundle).transformer(2047)
    assert next(network.parameters()).dtype == torch.float32
    torch.testing.assert_close(network.tri_token, tiny_network.tri_token, atol=1e-3, rtol=0)
    with pytest.raises(CheckpointError, match="transformer_2048.*incomplete"):
        Bundle(bundle).transformer(2048)
    assert Bundle(bundle).mapper("metallic_mapper")(torch.rand(2, 5)).shape == (2, 9)


def rewrite(file, change):
    state = load_file(file)
    change(state)
    file.unlink()
    save_file(state, file)


@pytest.mark.parametrize("change, message", [
    (lambda state: state.pop("tri_token"), "1 missing .first: tri_token"),
    (lambda state: state.update(extra=torch.zeros(1)), "1 unexpected .first: extra"),
    (lambda state: state.update(tri_token=torch.zeros(1, 1, 49)), r"tri_token has shape \(1, 1, 49\).*\(1, 1, 48\)"),
])
def test_wrong_tensors_are_named(saved, change, message):
    rewrite(saved / "model.safetensors", change)
    with pytest.raises(CheckpointError, match=message):
        load_network(saved)


def test_partial_download(saved):
    data = (saved / "model.safetensors").read_bytes()
    (saved / "model.safetensors").write_bytes(data[:len(data) // 2])
    with pytest.raises(CheckpointError, match="damaged or incomplete"):
        load_network(saved)
    (saved / "model.safetensors").unlink()
    with pytest.raises(CheckpointError, match="model.safetensors is missing"):
        load_network(saved)


def test_weights_that_are_not_floats_are_refused(saved):
    rewrite(saved / "model.safetensors", lambda state: state.update(tri_token=state["tri_token"].to(torch.int8)))
    with pytest.raises(CheckpointError, match="tri_token is stored as I8"):
        load_network(saved)


@pytest.mark.parametrize("value", [[], None, "tiny"])
def test_a_configuration_that_is_no_mapping_is_named(saved, value):
    file = saved / "config.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"model_config": value}))
    with pytest.raises(CheckpointError, match="config.json: model_config is not a JSON object"):
        load_network(saved)


def test_wrong_choice_of_a_folder_is_explained(bundle, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(CheckpointError, match="empty holds no weights: choose the folder renderformer-v2"):
        Renderer(tmp_path / "empty")
    with pytest.raises(CheckpointError, match="no weights folder .*nowhere: choose the one that the weights lie in"):
        Renderer(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="transformer_512 also needs diffspec_mapper"):
        Renderer(bundle / "transformer_512")
    with pytest.raises(CheckpointError, match="config.yaml is a file"):
        Renderer(bundle / "transformer_512" / "config.yaml")
    with pytest.raises(CheckpointError, match="needs diffspec_mapper, metallic_transmission_mapper,"):
        Renderer(bundle)
    with pytest.raises(CheckpointError, match="cannot be read .*too long"):
        Renderer(tmp_path / ("long" * 100))


@pytest.mark.parametrize("change", [{"hidden_dim": -16}, {"latent_dim": 8}, {"hidden_dim": "16"}])
def test_mappers_of_another_kind_are_refused(bundle, change):
    file = bundle / "metallic_mapper" / "config.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(CheckpointError, match="metallic_mapper/config.json does not fit MetallicMapper"):
        Bundle(bundle).mapper("metallic_mapper")


def test_pickles_and_version_one_are_refused(saved, bundle):
    (saved / "model.safetensors").rename(saved / "model.bin")
    with pytest.raises(CheckpointError, match="model.bin is a pickle"):
        load_network(saved)
    (saved / "config.json").write_text(json.dumps({"latent_dim": 768}))
    with pytest.raises(CheckpointError, match="V1"):
        load_network(saved)
    transformer = bundle / "transformer_512"
    (transformer / "config.json").write_text("{}")
    with pytest.raises(CheckpointError, match="both"):
        Bundle(bundle).transformer(512)
    (transformer / "config.yaml").unlink()
    with pytest.raises(CheckpointError, match="config.json belongs to a RenderFormer-V1 checkpoint"):
        Bundle(bundle).transformer(512)
    (bundle / "config.json").write_text("{}")
    with pytest.raises(CheckpointError, match="expected is the folder of RenderFormer/renderformer-v2"):
        Bundle(bundle)


@pytest.mark.parametrize("key, value, message", [
    ("colour", 1, "unknown keys.*colour"), ("pe_type", "nerf", "pe_type"), ("num_kv_heads", 1, "grouped"),
    ("norm_type", None, "norm_type"), ("latent_dim", "48", "latent_dim = '48' is not of the kind int"),
    ("latent_dim", 48.0, "latent_dim"), ("dim_feedforward", -64, "dim_feedforward"), ("use_volumes", 1, "use_volumes"),
    ("num_heads", 0, "num_heads = 0 must be at least 1"), ("dpt_out_layers", [0, 1, 2, 9], "four view layers"),
    ("dpt_out_channels", "abcd", "dpt_out_channels"), (5, 1, "unknown keys.*5"),
])
def test_configurations_of_other_networks_are_refused(bundle, key, value, message):
    file = bundle / "transformer_512" / "config.yaml"
    content = yaml.safe_load(file.read_text())
    content["model_config"][key] = value
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(CheckpointError, match=message):
        Bundle(bundle).transformer(512)
