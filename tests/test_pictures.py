# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes are converted, and pictures made of them, as when both were recorded: a change of structure changes no bit."""
import json

import bpy
import numpy as np
import pytest

from tests.pictures import (
    LIGHT,
    SCENES,
    SIZE,
    Computed,
    compute,
    copy,
    find_copies,
    is_close,
    kind,
    put_in_order,
    read_copies,
    read_hashes,
)
from tests.record_pictures import record


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_and_its_pictures_are_as_recorded(name):
    """Bit for bit on the kinds of processor that were recorded, and closely on all."""
    computed, copies = compute(name), read_copies()
    version, processor = kind()
    for light, picture in computed.pictures.items():
        assert picture.shape == (SIZE, SIZE, 3)
        assert any(is_close(picture, each) for each in find_copies(copies, name, light, version)), (
            f"{light}: see CONTRIBUTING.md, Check")
    recorded = read_hashes()[name].get(version, {}).get(processor, computed.hashes)
    changed = [of for of, value in computed.hashes.items() if value != recorded[of]]
    assert not changed, "no longer the same bit for bit: see CONTRIBUTING.md, Check"


def test_all_blenders_have_records_of_all_scenes():
    recorded, copies = read_hashes(), read_copies()
    assert set(recorded) == set(SCENES) and {tuple(key.split(", ")[:2]) for key in copies} == {
        (name, light) for name in SCENES for light in LIGHT}
    assert all({"4.5.15", "5.0.1", "5.2.3"} <= set(versions) for versions in recorded.values())


@pytest.mark.parametrize("changed, close", [(lambda p: p * np.float32(1.001), True), (lambda p: p * 1.05, False),
                                            (lambda p: np.roll(p, 1, axis=0), False), (lambda p: p + 0.02, False),
                                            (lambda p: np.where(np.arange(48 * 3).reshape(48, 3) % 50, p, 0), False)])
def test_a_picture_that_changes_visibly_is_not_close_to_its_copy(changed, close):
    picture = np.random.default_rng(0).random((48, 48, 3), np.float32)
    assert is_close(changed(picture).repeat(2, 0).repeat(2, 1), copy(picture.repeat(2, 0).repeat(2, 1))) == close


def test_faces_that_are_put_in_order_are_the_same_ones():
    def faces(mesh):
        return {tuple(sorted(tuple(mesh.vertices[i].co) for i in face.vertices)) for face in mesh.polygons}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_uv_sphere_add()
    mesh = bpy.context.object.data
    mesh.shade_smooth()
    before, normals = faces(mesh), [tuple(vertex.normal) for vertex in mesh.vertices]
    put_in_order(mesh)
    assert faces(mesh) == before and all(face.use_smooth for face in mesh.polygons)
    np.testing.assert_allclose([tuple(vertex.normal) for vertex in mesh.vertices], normals, atol=1e-5)


def test_a_record_replaces_those_of_other_processors_only_if_its_own_was_another():
    hashes, copies = {}, {}
    first, second = (Computed({"scene": value}, {}) for value in ("1", "2"))
    record(hashes, copies, "room", first, ("5.0.1", "A"))
    record(hashes, copies, "room", first, ("5.0.1", "B"))
    assert json.dumps(hashes) == '{"room": {"5.0.1": {"A": {"scene": "1"}, "B": {"scene": "1"}}}}'
    record(hashes, copies, "room", second, ("5.0.1", "B"))
    assert hashes == {"room": {"5.0.1": {"B": {"scene": "2"}}}}
