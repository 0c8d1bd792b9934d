# SPDX-License-Identifier: GPL-3.0-or-later
"""Fields that know how they behave are changed by what they are, wherever they stand."""
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from renderformer_v2.model.fields import COLOR, LENGTH, POINT, RADIANCE, Channels, array, check_arrays, map_arrays, rows
from renderformer_v2.model.scene import RenderScene, Volumes
from tests.model.samples import floor_scene

PARTS = Channels(1, position=(3, POINT), weight=1, colors=(6, COLOR))


@dataclass
class Inner:
    size: np.ndarray = array("N", behaves=LENGTH)


@dataclass
class Group:
    place: np.ndarray = array("N", 3, behaves=POINT)
    light: np.ndarray = array(3, "N", behaves={COLOR: 0, RADIANCE: -1})
    parts: np.ndarray = array("N", len(PARTS), channels=PARTS)
    count: np.ndarray = rows("N", dtype=np.int32)
    inner: Inner | None = None


def group(kind):
    number = np.arange(20, dtype=np.float32).reshape(2, 10)
    made = {"place": number[:, :3], "light": number[:, :3].T.copy(), "parts": number, "inner": Inner(number[:, 0])}
    as_kind = {"numpy": lambda x: x, "torch": torch.from_numpy}[kind]
    return Group(**{name: as_kind(x) if isinstance(x, np.ndarray) else Inner(as_kind(x.size))
                    for name, x in made.items()})


def swap(x):
    """First and second channel of every triple."""
    return x.reshape(*x.shape[:-1], -1, 3)[..., [1, 0, 2]].reshape(x.shape)


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_each_behaviour_is_changed_on_its_axis_and_nothing_else(kind):
    before = group(kind)
    after = map_arrays(before, {POINT: lambda x: x + 100, COLOR: swap, LENGTH: lambda x: x * 2})
    assert after.place.tolist() == [[100, 101, 102], [110, 111, 112]]
    assert after.light.tolist() == [[1, 11], [0, 10], [2, 12]]
    assert after.parts.tolist()[0] == [100, 101, 102, 3, 5, 4, 6, 8, 7, 9]
    assert after.inner.size.tolist() == [0, 20]
    assert before.parts.tolist()[0] == list(range(10)) and before.inner.size.tolist() == [0, 10]


def test_what_does_not_change_is_not_copied():
    before = group("numpy")
    after = map_arrays(before, {POINT: lambda x: x, RADIANCE: lambda x: x * 3})
    assert after.parts is before.parts and after.place is before.place
    assert (after.light == 3 * before.light).all()


def test_checks_name_the_array_and_what_is_wrong():
    good = group("numpy")
    check_arrays(good.inner)
    for name, value, message in (("place", np.zeros((2, 4), np.float32), r"place is float32\(2, 4\)"),
                                 ("place", np.zeros((2, 3)), "place is float64"),
                                 ("parts", np.zeros((5, 10), np.float32), r"parts .*expected float32\(2, 10\)"),
                                 ("place", np.full((2, 3), np.nan, np.float32), "place holds values")):
        bad = group("numpy")
        setattr(bad, name, value)
        with pytest.raises(ValueError, match=message):
            check_arrays(bad)


def test_a_scene_says_which_array_breaks_its_contract():
    RenderScene().validate()
    scene = floor_scene()
    scene.validate()
    scene.tile_index[3] = 1
    with pytest.raises(ValueError, match="tile_index reaches outside"):
        scene.validate()
    cells = {name: np.zeros((2, 3), np.float32) for name in ("position", "rotation", "scale", "scattering")}
    scene = floor_scene()
    scene.volumes = Volumes(np.zeros((2, 64), np.float32), *cells.values(), np.zeros((1, 3), np.float32))
    with pytest.raises(ValueError, match="volumes.absorption"):
        scene.validate()


def test_appended_triangles_find_their_tiles():
    first, second = floor_scene(2), floor_scene(3)
    second.tiles[0, 0] = 0.25
    both = first.appended(second)
    both.validate()
    assert len(both) == len(first) + len(second) and len(both.tiles) == 2
    assert (both.tiles[both.tile_index[len(first):], 0] == 0.25).all()
