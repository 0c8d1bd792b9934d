# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are damaged or half there, and files that hold something already."""
import bpy
import numpy as np
import pytest
from skimage.io import imsave

from bl_ext.user_default.renderformer_v2.model.published.obj_mesh import read_obj
from bl_ext.user_default.renderformer_v2.model.published.prepared_frame import read_frame
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.importing import import_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.model.published import frames
from tests.rf2_engine import f12
from tests.rf2_engine.paper_scenes.test_paper_scenes import lobes_at, shown, tile_at

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


@pytest.mark.parametrize("kind", ["gray", "gray and alpha", "alpha", "16 bits", "small"])
def test_maps_of_any_kind_of_png_are_the_numbers_in_them(frame, kind):
    value, side = (0.25, 8 if kind == "small" else 256)
    pixels = np.full((side, side, 4), round(255 * value), np.uint8)
    pixels[..., 3] = 0
    pixels = {"gray": pixels[..., 0], "gray and alpha": pixels[..., 2:], "alpha": pixels, "small": pixels[..., :3],
              "16 bits": pixels[..., 0].astype(np.uint16) * 257}[kind]
    imsave(frame / "split" / "rust" / "base_color.png", pixels, check_contrast=False)
    rust = tile_at(shown(import_frame(frame, Report()))[0], (0.1, 0.25, 0.5))
    np.testing.assert_allclose(rust[BASE_COLOR], value, atol=5e-3)


def test_an_image_that_was_loaded_before_keeps_its_settings(frame):
    mine = bpy.data.images.load(str(frame / "split" / "cloth" / "diffuse.png"))
    import_frame(frame, Report())
    assert mine.colorspace_settings.name == "sRGB" and mine.alpha_mode != "NONE" and not mine.users
    count = len(bpy.data.images)
    import_frame(frame, Report())
    assert len(bpy.data.images) == count


@pytest.mark.parametrize("name", ["new", "new.json", "scene_config.JSON"])
def test_an_export_is_a_folder_whatever_its_name_ends_with(scene, tmp_path, name):
    f12.cube(scene)
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / name)) == {"FINISHED"}
    assert (tmp_path / name.partition(".")[0] / "scene_config.json").is_file()


def test_an_export_that_cannot_be_is_said_in_a_line_and_leaves_nothing(scene, tmp_path):
    def said(*names: str) -> str:
        with pytest.raises(RuntimeError) as raised:
            bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path.joinpath(*names)))
        assert "Traceback" not in str(raised.value)
        return str(raised.value)

    (tmp_path / "file").write_text("mine")
    assert "shows no surface" in said("new")
    f12.cube(scene)
    assert "cannot be written: Not a directory" in said("file", "new")
    assert "is not empty" in said("file")
    camera, scene.camera = scene.camera, None
    assert "has no camera: add one" in said("new")
    scene.camera = camera
    camera.data.shift_x = 0.1
    assert "lens shift" in said("new")
    assert [path.name for path in tmp_path.iterdir()] == ["file"] and (tmp_path / "file").read_text() == "mine"
    assert scene.render.engine == "RENDERFORMER_V2"


def test_what_is_in_edit_mode_is_exported_and_rendered(scene, tmp_path):
    cube = f12.cube(scene, of=f12.material("Red", (0.8, 0.05, 0.05)))
    cube.data.uv_layers.new(name="UVMap")
    bpy.context.view_layer.objects.active = cube
    bpy.ops.object.mode_set(mode="EDIT")
    converted, _ = shown(scene)
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "new")) == {"FINISHED"}
    scene.renderformer_v2.guide_samples, scene.render.resolution_x, scene.render.resolution_y = 1, 32, 32
    f12.press_f12(scene, tmp_path)
    bpy.ops.object.mode_set(mode="OBJECT")
    (layer,) = last_render.last_frame
    assert len(converted) == layer.triangles == len(shown(scene)[0]) >= 12
    np.testing.assert_allclose(converted.tiles[0, :3, 0, 0], (0.8, 0.05, 0.05), atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(converted.normals, axis=-1), 1, atol=1e-3)
    assert read_obj(tmp_path / "new" / "split" / "Cube.obj").uv is not None
    exported = read_frame(tmp_path / "new").objects["Cube"].material
    assert exported.numbers["base_color"][0] == pytest.approx(0.8, abs=1e-3)
