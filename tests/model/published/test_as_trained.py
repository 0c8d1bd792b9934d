# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes as the published network was trained on them: weak emission is no light, and what no camera sees is
removed; and what is reported of scenes that are unlike the training data.
"""
import re
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.published.as_trained import GLOW, as_trained, describe_untrained, find_emitters
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.scene import RenderScene, Volumes, constant_tile
from tests.model.samples import flat, floor_scene, floor_view


@pytest.fixture(scope="module")
def renderer(published_bundle) -> Renderer:
    return Renderer(published_bundle, device="cpu", precision="fp32")


def glowing(share: float, triangles: slice = slice(0, 2)) -> RenderScene:
    """The floor under its lamp, of which some triangles shine with `share` of GLOW."""
    scene = floor_scene()
    scene.box = np.float32([(-1, -1, -1), (1, 1, 1)])
    scene.emission[triangles] = share * GLOW / Normalization.of(scene).exposure
    return scene


def of_network(scene: RenderScene) -> np.ndarray:
    return find_emitters(Normalization.of(scene).scene(scene))


def test_a_surface_that_glows_weakly_is_no_light_and_a_bright_one_is():
    assert of_network(glowing(0.5)).nonzero()[0].tolist() == [128]
    assert of_network(glowing(4.0)).nonzero()[0].tolist() == [0, 1, 128]


def test_a_lamp_that_no_camera_sees_stays_a_light_however_weak():
    scene = glowing(0.5)
    scene.seen = np.arange(len(scene)) > 0
    assert of_network(scene).nonzero()[0].tolist() == [0, 128]


def test_glow_that_lights_the_scene_is_light():
    scene = glowing(0.9, slice(0, 128))
    assert of_network(scene).all()
    dark = floor_scene(radiance=0)
    dark.emission[:64] = 1
    assert of_network(dark).sum() == 64


def test_what_glows_weakly_keeps_the_light_that_it_reflects(renderer):
    """Its pixels were cleared before, and its tile was that of a white lamp."""
    scene, (view, guides) = glowing(0.5), floor_view()
    guides.emission[guides.hit_triangle == 0] = scene.emission[0]
    picture = renderer.encode(scene).view(view, guides)
    dark = replace(scene, emission=scene.emission * (np.arange(len(scene)) == 128)[:, None])
    assert Normalization.of(dark).exposure == pytest.approx(Normalization.of(scene).exposure, rel=0.05)
    expected = renderer.encode(dark).view(view, guides)
    assert picture[guides.alpha > 0].mean() > 0
    np.testing.assert_allclose(picture, expected, rtol=0.1, atol=0.02 * expected.max())


def test_what_no_camera_sees_is_no_token(renderer):
    scene = glowing(0)
    plate = flat(scene.triangles[-1:] + np.float32((0, 0, 0.01)), (0, 0, 0))
    plate.seen = np.zeros(1, bool)
    backed = scene.appended(plate)
    emits = find_emitters(backed)
    told = as_trained(backed, emits)
    assert len(told) == len(scene) and told.is_seen.all() and emits.tolist() == [*[False] * 128, True, False]
    view, guides = floor_view()
    with_plate, without = renderer.encode(backed), renderer.encode(scene)
    assert with_plate.tokens == without.tokens
    np.testing.assert_array_equal(with_plate.view(view, guides), without.view(view, guides))


def test_the_exported_scene_is_what_is_rendered(renderer):
    scene, (view, _) = glowing(0.5), floor_view()
    lamp = flat(np.float32([[(0, 0, 1), (0.1, 0, 1), (0, 0.1, 1)]]), (0, 0, 0))
    lamp.seen, lamp.tiles[:] = np.zeros(1, bool), constant_tile((0, 0, 0))
    processed = renderer.pipeline.process(scene.appended(lamp), [view])
    assert len(processed.triangles) == len(scene) and (processed.light_strength > 0).any(axis=1).sum() == 1


def as_in_training() -> RenderScene:
    """A floor under one equilateral light of edge 0.16 in a distance of 2.4, in network units."""
    scene = floor_scene(radiance=3000)
    scene.triangles[:-1] *= 0.5
    scene.triangles[-1] = np.array([(0, 0, 0), (0.16, 0, 0), (0.08, 0.08 * np.sqrt(3), 0)]) + (0, 0, 2.4)
    return scene


def fog(side: float) -> Volumes:
    three = np.full((5, 3), side, np.float32)
    return Volumes(np.ones((5, 64), np.float32), 0 * three, 0 * three, three, three, three)


def test_nothing_is_said_of_a_scene_as_in_training():
    scene = as_in_training()
    scene.volumes = fog(0.5)
    assert describe_untrained(scene) == []


def many(scene):
    scene.emission[-9:] = 3000


def inside(scene):
    scene.triangles[-1] -= np.float32((0, 0, 2))


def dim(scene):
    scene.emission[-1] = 20


def large(scene):
    scene.triangles[-1, :, :2] *= 3


def dark(scene):
    scene.emission[:] = 0


def thin(scene):
    scene.volumes = fog(0.25)


@pytest.mark.parametrize("change, message", [
    (many, "9 triangles are lights, .* 1 to 8"), (inside, "1 of 1 light triangles are inside"),
    (dim, "1 of 1 .* less than 0.33 times as bright .*0.064"), (large, "more than 3 times as large"),
    (dark, "no triangle is a light"), (thin, "5 of 5 volume cells are thinner .*2.0 times"),
])
def test_what_is_unlike_training_is_said(change, message):
    scene = as_in_training()
    change(scene)
    assert any(re.search(message, line) for line in describe_untrained(scene)), describe_untrained(scene)
