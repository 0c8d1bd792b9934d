# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are damaged or half there, and files that hold something already."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.importing import import_frame

from tests.model.published import frames
from tests.rf2_engine.paper_scenes.test_paper_scenes import lobes_at, shown

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 7\n"


@pytest.fixture
def frame(scene, tmp_path):
    return frames.write(tmp_path / "frame")


@pytest.mark.parametrize("name, content, said", [
    ("metal.obj", POINTER, "metal.obj stands for a file that was not downloaded: run `git lfs pull`"),
    ("cloth/diffuse.png", POINTER, "diffuse.png stands for a file that was not downloaded"),
    ("metal.obj", b"v 0 0 0\nv 1 0 0\n", "metal.obj has no face that has an area"),
    ("metal.obj", bytes(range(256)) * 20, "metal.obj has no face that has an area"),
    ("metal.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "infinite or invalid vertices"),
    ("cloth/diffuse.png", b"hello", "diffuse.png\" cannot be read"),
    ("measured/latent.npy", b"hello", "latent.npy is no .npy file of numbers")])
def test_a_file_that_is_none_is_named_and_the_rest_is_shown(frame, name, content, said):
    (frame / "split" / name).write_bytes(content)
    report = Report()
    converted, _ = shown(import_frame(frame, report), report)
    assert any(said in line for line in report.lines()), report.lines()
    assert len(converted) >= 12 and np.isfinite(converted.tiles).all()


@pytest.mark.parametrize("normal", ["0 0 0", "nan 0 0", "1e30 0 0"])
def test_normals_that_are_none_are_made_anew(frame, normal):
    (frame / "split" / "metal.obj").write_text(
        f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn {normal}\nf 1//1 2//1 3//1\n")
    converted, _ = shown(import_frame(frame, Report()))
    np.testing.assert_allclose(np.linalg.norm(converted.normals, axis=-1), 1, atol=1e-3)


@pytest.mark.parametrize("kind", ["ShaderNodeTree", "GeometryNodeTree"])
def test_a_node_group_of_the_same_name_is_left_alone(frame, kind):
    for group in [it for it in bpy.data.node_groups if it.name.startswith("SpecularRoughnessBSDF")]:
        bpy.data.node_groups.remove(group)
    mine = bpy.data.node_groups.new("SpecularRoughnessBSDF", kind)
    converted, _ = shown(import_frame(frame, Report()))
    np.testing.assert_allclose(lobes_at(converted, (-0.4, 0, 0))[:3, 0, 0], frames.DIFFUSE["diffuse"], atol=1e-3)
    assert not mine.nodes and not mine.users
    groups = len(bpy.data.node_groups)
    import_frame(frame, Report())
    assert len(bpy.data.node_groups) == groups


def test_what_is_in_the_file_already_stays_as_it_is(frame):
    for made in (bpy.data.materials.new("floor"), bpy.data.meshes.new("floor"), bpy.data.worlds.new("every-type"),
                 bpy.data.scenes.new("every-type"), bpy.data.cameras.new("Camera")):
        made["mine"] = True
    before = {group: set(getattr(bpy.data, group)) for group in ("materials", "meshes", "worlds", "scenes", "cameras")}
    imported = import_frame(frame, Report())
    assert imported not in before["scenes"] and imported.world not in before["worlds"]
    for it in imported.objects:
        assert it.data not in before["meshes"] | before["cameras"]
        assert not {slot.material for slot in it.material_slots} & before["materials"]
