# SPDX-License-Identifier: GPL-3.0-or-later
"""The transformer is in every picture that stays; what a picture does not show is not computed."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.guided.bundle_decoder import BundleDecoder
from renderformer_v2.model.guided.fusion import Fusion
from renderformer_v2.model.guided.kernels import LATENT
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.effort import FULL
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


def test_the_picture_is_that_of_the_network_and_knows_both_estimates_of_traced_light(renderer, traced_points):
    view, guides = floor_view()
    traced = replace(guides, traced=np.full(guides.diffuse_color.shape, 0.25, np.float32))
    encoded = renderer.encode(walls((0.6, 0.2, 0.2)))
    traced_points.clear()
    ours, quick = (encoded.view(view, traced, effort) for effort in (FULL, replace(FULL, network=False)))
    assert traced_points and np.abs(ours - quick).max() > 1e-3
    lobes = encoded.lobes(view, traced)
    np.testing.assert_array_equal(lobes.radiance, ours)
    assert lobes.latent.shape == (64, 64, LATENT)


def test_a_draft_traces_no_shadows_where_light_was_traced(renderer, traced_points):
    view, guides = floor_view()
    traced = replace(guides, traced=np.full(guides.diffuse_color.shape, 0.25, np.float32))
    draft = renderer.encode(walls((0.6, 0.2, 0.2)), draft=True)
    assert draft.is_draft and not draft.finished().is_draft
    traced_points.clear()
    draft.view(view, traced)
    assert not traced_points
    draft.view(view, guides)
    assert traced_points


def test_the_transformer_alone_needs_no_rays_and_no_trees_for_them(traced_points, monkeypatch):
    """Its picture is another one, and the scene may as well hide everything from each other."""
    view, guides = floor_view()
    alone, with_rays = (Renderer(device="cpu", precision="fp32", rays=rays) for rays in (False, True))
    with monkeypatch.context() as without:
        without.delattr("renderformer_v2.model.rays._make_caster")
        picture = alone.encode(walls((0.6, 0.2, 0.2))).view(view, guides)
    assert not traced_points and np.isfinite(picture).all() and picture.max() > 0.01
    with_rays = with_rays.encode(walls((0.6, 0.2, 0.2)))
    assert np.abs(picture - with_rays.view(view, guides)).max() > 1e-3


@pytest.mark.parametrize(("speaker", "rays", "is_traced", "least"), [
    (BundleDecoder, False, False, 0.02), (Fusion, True, True, 1e-3), (Fusion, True, False, 1e-3)])
def test_what_attention_says_changes_every_picture(speaker, rays, is_traced, least, monkeypatch):
    """A decoder can do without it, and training has ended so: all of it was convolution, and no test knew."""
    view, guides = floor_view()
    if is_traced:
        guides = replace(guides, traced=np.full(guides.diffuse_color.shape, 0.25, np.float32))
    encoded = Renderer(device="cpu", precision="fp32", rays=rays).encode(walls((0.6, 0.2, 0.2)))
    assert (encoded.tokens > len(walls((0.6, 0.2, 0.2)))) is not rays
    picture = encoded.view(view, guides)
    speak = speaker.forward
    monkeypatch.setattr(speaker, "forward", lambda self, *inputs: 0 * speak(self, *inputs))
    assert np.abs(encoded.view(view, guides) - picture).max() > least * picture.mean()
