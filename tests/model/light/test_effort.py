# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that others soon replace cost a part of the light of finished ones."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model import rays
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.effort import DRAFT, FULL, QUICK
from renderformer_v2.model.light.estimate import SceneLight, estimate_light
from renderformer_v2.model.renderer import Renderer
from tests.model.samples import floor_scene, floor_view, walls


@pytest.fixture
def counted(monkeypatch):
    """How many rays were cast."""
    cast = {"count": 0}

    def counting(real):
        def counted(self, origin, direction, *rest):
            cast["count"] += len(direction)
            return real(self, origin, direction, *rest)
        return counted
    for name in ("closest", "blocked"):
        monkeypatch.setattr(rays.Rays, name, counting(getattr(rays.Rays, name)))
    return cast


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(device="cpu", precision="fp32")


def lit_room():
    return replace(walls((0.6, 0.2, 0.2)), environment=np.full((8, 16, 3), 0.5, np.float32))


def test_quick_light_is_that_of_fewer_rays(counted):
    scene, (view, guides), estimates, costs = lit_room(), floor_view(), [], []
    direct = DirectLight(scene)
    for effort in (FULL, QUICK):
        counted["count"] = 0
        light = SceneLight(scene, direct, Radiosity(scene, direct, effort))
        estimates.append(estimate_light(light, view, guides, effort))
        costs.append(counted["count"])
    assert costs[1] < 0.4 * costs[0]
    for name in ("direct", "bounced"):
        full, quick = (getattr(estimate, name) for estimate in estimates)
        assert (full - quick).abs().mean() < 0.15 * full.mean()


def test_small_pictures_have_as_many_rays_as_larger_ones_up_to_eight_times_as_many_a_pixel():
    sizes = 512 * 512, 256 * 256, 256 * 128, 128 * 128, 16 * 16
    for count in ("of", "of_probe"):
        assert [getattr(FULL.of_picture(pixels), count)(24) for pixels in sizes] == [24, 48, 96, 192, 192]
    assert QUICK.of_picture(64 * 64) == QUICK


def test_a_draft_shows_the_light_that_the_network_starts_from(renderer):
    scene, (view, guides) = lit_room(), floor_view()
    draft, whole = renderer.encode(scene, draft=True), renderer.encode(scene)
    assert draft.is_draft and draft.encoded.context is None and not whole.is_draft
    shown = draft.view(view, guides)
    assert 0.5 < shown.sum() / whole.view(view, guides).sum() < 2
    finished = draft.finished()
    assert not finished.is_draft
    np.testing.assert_array_equal(finished.view(view, guides), whole.view(view, guides))


def test_light_of_drafts_bounces_between_fewer_patches():
    scene = lit_room()
    direct = DirectLight(scene)
    full, draft = (Radiosity(scene, direct, effort).leaving for effort in (FULL, DRAFT))
    assert 0.1 * len(full) < len(draft) < 0.2 * len(full)
    assert draft.mean() == pytest.approx(full.mean().item(), rel=0.15)


def test_drafts_are_dark_where_nothing_shines(renderer):
    scene, (view, guides) = floor_scene(radiance=0.0), floor_view()
    assert not renderer.encode(scene, draft=True).view(view, guides).any()
