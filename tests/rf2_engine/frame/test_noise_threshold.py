# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' own adaptive sampling in the first hits: as many samples as the picture needs."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session as cycles_session

from tests.rf2_engine.f12 import cube, mesh_object, press_f12

MOST = 64


@pytest.fixture
def shadow(scene):
    """A cube on a floor that ends halfway up the picture, under an area lamp: soft shadows, then empty sky."""
    cube(scene)
    mesh_object(scene, "Floor", [(-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1)], [(0, 1, 2, 3)])
    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.energy, lamp.size = 300, 2
    light = bpy.data.objects.new("Lamp", lamp)
    light.location = (1, -1, 4)
    scene.collection.objects.link(light)
    ours = scene.renderformer_v2
    ours.guide_samples, ours.use_adaptive_sampling, ours.adaptive_threshold = MOST, True, 0.05
    ours.adaptive_min_samples = 4
    return scene


@pytest.fixture
def taken(monkeypatch):
    """(H, W) samples of the pixels of each session of Cycles."""
    sessions = []

    def render_views(engine, depsgraph, options, report, real=cycles_session.render_views):
        views = real(engine, depsgraph, options, report)
        sessions.extend(passes["samples"][..., 0] for passes in views.values())
        return views
    monkeypatch.setattr(cycles_session, "render_views", render_views)
    return sessions


def test_clean_pixels_have_fewer_samples_than_noisy_ones(shadow, taken, tmp_path):
    found = press_f12(shadow, tmp_path)["ViewLayer.Combined"]
    (samples,) = taken
    assert (samples[:3, :5] == 16).all() and samples.max() == MOST
    assert 18 < samples.mean() < 0.75 * MOST and np.isfinite(found).all()
    assert found[:3, :5, :3] == pytest.approx(0.25, abs=0.01)  # the sky is the sky, however many samples it has


def test_a_lower_threshold_takes_more_samples_and_min_samples_are_kept(shadow, taken, tmp_path):
    for threshold, least in ((0.5, 4), (0.02, 4), (0.5, 40)):
        shadow.renderformer_v2.adaptive_threshold, shadow.renderformer_v2.adaptive_min_samples = threshold, least
        press_f12(shadow, tmp_path)
    few, many, at_least = taken
    assert few.mean() < many.mean() and few.min() == 16 and at_least.min() == 48  # the first look after 40


def test_two_renders_and_a_part_of_one_have_the_same_samples(shadow, taken, tmp_path):
    whole = press_f12(shadow, tmp_path)["ViewLayer.Combined"]
    again = press_f12(shadow, tmp_path)["ViewLayer.Combined"]
    shadow.render.use_border, shadow.render.border_max_x = True, 0.5
    press_f12(shadow, tmp_path)
    first, second, part = taken
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(whole, again, atol=1e-4)
    np.testing.assert_array_equal(first[:, :20], part[:, :20])  # the noise of neighbours outside is not known


@pytest.mark.parametrize("change", ["network alone", "holdout"])
def test_all_pixels_have_all_samples_where_noise_says_nothing_and_where_pictures_are_subtracted(shadow, taken, tmp_path,
                                                                                              change):
    if change == "holdout":
        bpy.data.objects["Cube"].is_holdout = True
    else:
        shadow.renderformer_v2.light = "NETWORK"
    press_f12(shadow, tmp_path)
    assert all((samples == MOST).all() for samples in taken)


def test_a_blurred_picture_has_more_samples_where_it_is_noisy(shadow, taken, tmp_path):
    dof = shadow.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 5, 0.2
    found = press_f12(shadow, tmp_path)["ViewLayer.Combined"]
    picture, *lens = taken
    assert len(lens) == 2 and picture.min() < MOST // 2 < picture.max() <= MOST
    assert all(samples.max() <= MOST // 2 for samples in lens) and np.isfinite(found).all()
