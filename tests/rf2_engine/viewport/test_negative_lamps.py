# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewports show what lamps of negative strength take away, as a render does."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Session

from tests.rf2_engine.f12 import press_f12
from tests.rf2_engine.rooms import assert_alike, lamp, room
from tests.rf2_engine.viewport.views import pictures, read, request, through_camera


@pytest.fixture
def darkened(scene):
    """A room with a lamp and a dark one."""
    room(scene)
    lamp(scene)
    lamp(scene, (1.2, 0.5, 1.5), (0, 0, 0), -40, "POINT").name = "Dark"
    scene.renderformer_v2.light = "NETWORK"
    scene.render.resolution_x, scene.render.resolution_y = 96, 64
    return scene


def shown(scene):
    """The pictures of a viewport, coarse to fine."""
    session = Session()
    session.submit(request(scene, read(), through_camera(scene, 96, 64)))
    return [picture.pixels[..., :3] for picture in pictures(session) if picture]


def test_a_negative_lamp_takes_light_away_at_every_level(darkened, tmp_path):
    rendered = press_f12(darkened, tmp_path)["ViewLayer.Combined"][..., :3]
    with_it = shown(darkened)
    darkened.objects["Dark"].hide_render = darkened.objects["Dark"].hide_viewport = True
    without = shown(darkened)
    assert_alike(with_it[-1], rendered, rtol=0.15)
    for picture, lit in zip(with_it, without, strict=True):
        height, width, _ = picture.shape
        right = np.s_[:, width // 2:]
        assert picture[right].mean() < 0.8 * lit[right].mean() and picture.min() >= 0
