# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of scenes that are unlike the training data."""
import re

import numpy as np
import pytest

from renderformer_v2.model.published.as_trained import remarks
from renderformer_v2.model.scene import RenderScene, Volumes
from tests.model.samples import floor_scene


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
    assert remarks(scene) == []


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
    assert any(re.search(message, line) for line in remarks(scene)), remarks(scene)
