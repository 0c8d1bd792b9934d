# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture does not show is not computed."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.renderer import Renderer
from tests.model.samples import floor_view, walls


@pytest.fixture
def renderer() -> Renderer:
    return Renderer(device="cpu", precision="fp32")


@pytest.fixture
def traced_points(monkeypatch):
    """A list with an entry for every time that shadows of emitters are traced."""
    calls, real = [], DirectLight.emitter_visibility

    def spied(self, position, *rest):
        calls.append(len(position))
        return real(self, position, *rest)
    monkeypatch.setattr(DirectLight, "emitter_visibility", spied)
    return calls


def test_shadows_of_emitters_at_pixels_only_where_no_light_was_traced(renderer, traced_points):
    view, guides = floor_view()
    traced = replace(guides, traced=np.full(guides.diffuse_color.shape, 0.25, np.float32))
    encoded = renderer.encode(walls((0.6, 0.2, 0.2)))

    traced_points.clear()
    displayed = encoded.lobes(view, traced, apart=False).radiance
    assert not traced_points
    apart = encoded.lobes(view, traced)
    assert traced_points and apart.direct.any()
    np.testing.assert_array_equal(displayed, apart.radiance)

    traced_points.clear()
    encoded.view(view, guides)
    assert traced_points


def test_kernels_alone_need_no_tokens_and_no_material_mapper(renderer):
    pipeline, encoded = renderer.pipeline, renderer.encode(walls((0.6, 0.2, 0.2)))
    assert pipeline.transformer is None and pipeline.mapper is None
    assert encoded.encoded.context is None and encoded.tokens == 0
