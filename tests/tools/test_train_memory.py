# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers that are computed twice: the same gradients, from fewer stored numbers."""
import pytest
import torch

from renderformer_v2.model.camera import square_view
from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network.inputs import view_inputs
from tests.model.published.bundles import tiny_published_config
from tools.benchmark import ring
from tools.benchmark.point import random_inputs
from tools.train.errors import TrainingError
from tools.train.memory import recompute

CONFIG = tiny_published_config()


def gradients(parts: tuple[str, ...], precision: torch.dtype) -> tuple[dict[str, torch.Tensor], int]:
    """Of the mean of a picture, and the numbers that are stored on the way."""
    torch.manual_seed(0)
    network, stored = new_network(CONFIG), 0
    recompute(network, parts)

    def count(x: torch.Tensor) -> torch.Tensor:
        nonlocal stored
        stored += x.numel()
        return x

    inputs = random_inputs(ring.LEAST, CONFIG)
    rays = view_inputs(square_view(ring.camera_to_world(), ring.FIELD_OF_VIEW, 64))
    with (torch.autograd.graph.saved_tensors_hooks(count, lambda x: x),
          torch.autocast("cpu", precision, enabled=precision != torch.float32)):
        network(inputs, rays).mean().backward()
    return {name: p.grad for name, p in network.named_parameters() if p.grad is not None}, stored


@pytest.mark.parametrize("precision", [torch.float32, torch.bfloat16])
def test_gradients_stay_the_same_and_less_is_stored(precision):
    expected, most = gradients((), precision)
    for parts in (("transformer.",), ("transformer.", "view_transformer.")):
        found, stored = gradients(parts, precision)
        assert found.keys() == expected.keys() and stored < 0.8 * most
        for name, gradient in expected.items():
            torch.testing.assert_close(found[name], gradient, msg=lambda m, name=name: f"{name}: {m}")
        most = stored


def test_a_part_without_layers_is_said():
    with pytest.raises(TrainingError, match="recomputed: no transformer layer's name begins with 'encoder'"):
        recompute(new_network(CONFIG), ("transformer.", "encoder"))
