# SPDX-License-Identifier: GPL-3.0-or-later
"""Published weights draw viewports as they draw renders, by themselves."""
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Session

from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine.f12 import cube, press_f12, sun
from tests.rf2_engine.viewport.views import pictures, read, request, through_camera


@pytest.fixture
def published(scene, tmp_path):
    folder = write_bundle(tmp_path / "renderformer-v2", tiny_published_config(), ("transformer_512",
                                                                                  "transformer_2048"))
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", str(folder)
    scene.render.resolution_x, scene.render.resolution_y = 128, 64
    cube(scene).rotation_euler = (0.3, 0.2, 0.5)
    sun(scene)
    return scene


def test_the_finest_level_is_the_picture_of_a_render(published, tmp_path):
    published.render.film_transparent = True
    rendered = press_f12(published, tmp_path)["ViewLayer.Combined"]
    session = Session()
    session.submit(request(published, read(), through_camera(published, 128, 64)))
    shown = [picture for picture in pictures(session) if picture]
    assert [picture.divisor for picture in shown] == [8, 4, 2, 1]
    ours, inside = shown[-1].pixels, (shown[-1].pixels[..., 3] == 1) & (rendered[..., 3] == 1)
    peak = rendered[inside].max()  # of a network with random weights; at edges there are more samples here
    assert inside.sum() > 500 and psnr(ours[inside, :3][None] / peak, rendered[inside, :3][None] / peak) > 30


def test_coarse_levels_of_a_large_region_are_drawn_by_the_network_for_large_pictures(published):
    published.renderformer_v2.viewport.resolution = "8"
    session = Session()
    session.submit(request(published, read(), through_camera(published, 2048, 128)))
    pictures(session)
    assert session._scene.encoded.variant == "transformer_2048"
