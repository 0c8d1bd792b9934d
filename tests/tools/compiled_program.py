# SPDX-License-Identifier: GPL-3.0-or-later
"""A program of its own, because a compiler cannot be looked for where other tests have changed Python's distutils."""
import torch

import tools  # noqa: F401  makes the package `renderformer_v2` importable
from renderformer_v2.model.network.layers import SwiGLU
from tools.train.run import compile_parts

if __name__ == "__main__":
    torch._dynamo.config.suppress_errors = False
    model = SwiGLU(8, 16)
    x, names = torch.rand(5, 8), set(model.state_dict())
    expected = model(x)
    compile_parts(model)
    found = model(x)
    torch.testing.assert_close(found, expected)
    found.sum().backward()
    assert set(model.state_dict()) == names and model.w1.weight.grad.abs().sum() > 0
