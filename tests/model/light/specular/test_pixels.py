# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of what mirrors and glass show."""
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.probes import Probes
from renderformer_v2.model.light.specular.pixels import path_end_light
from tests.model.samples import floor_view

LIGHT = {None: 0.0, 1: 2.0, 3: 5.0}  # by group of surfaces
SIZE = 32


def shown(groups: np.ndarray | None) -> np.ndarray:
    """(SIZE, SIZE) what mirrors show of a floor whose groups those are."""
    _, guides = floor_view(SIZE, SIZE)
    guides = replace(guides, reflected_position=guides.position, reflected_normal=guides.normal,
                     reflected_color=np.ones_like(guides.position), reflected_group=groups)

    def outgoing(group):
        return lambda x, n, number: {"complete": torch.full_like(x, LIGHT[group])}

    light, _ = path_end_light(partial(Probes, grid=2, finest=1), outgoing, torch.device("cpu"), "reflected", guides)
    return light["complete"][..., 0].numpy()


def test_each_surface_that_a_mirror_shows_has_the_light_that_lights_its_group():
    groups = np.ones((SIZE, SIZE, 1), np.float16)
    groups[:, SIZE // 2:] = 3
    found = shown(groups)[8:24, 8:24]
    assert found[:, :8] == pytest.approx(LIGHT[1], rel=1e-4) and found[:, 8:] == pytest.approx(LIGHT[3], rel=1e-4)


def test_where_lights_tell_no_groups_apart_all_has_the_light_of_all():
    assert not shown(None).any()
