# SPDX-License-Identifier: GPL-3.0-or-later
"""What the surfaces that pixels show reflect."""
import torch

from renderformer_v2.model.light.hit_surfaces import HitSurfaces
from tests.model.samples import floor_scene, floor_view


def test_what_leans_away_from_the_viewer_shows_no_gloss():
    scene, (view, guides) = floor_scene(), floor_view()
    guides.normal[:, :32] *= -1
    is_toward = HitSurfaces.of(scene, view, guides, 0, torch.device("cpu")).is_toward
    assert not is_toward[32, 24] and is_toward[32, 40]
