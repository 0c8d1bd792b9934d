# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepared frames of the research code become Blender scenes, and Blender scenes become such frames."""
import json
import shutil

import bpy
import numpy as np
import pytest
from skimage.io import imread

from bl_ext.user_default.renderformer_v2.model.environment import rotate_environment
from bl_ext.user_default.renderformer_v2.model.errors import SceneError
from bl_ext.user_default.renderformer_v2.model.normalize import Normalization
from bl_ext.user_default.renderformer_v2.model.published.obj_mesh import read_obj
from bl_ext.user_default.renderformer_v2.model.published.prepared_frame import find_missing_files, read_frame
from bl_ext.user_default.renderformer_v2.model.scene import (
    BASE_COLOR,
    HEIGHT,
    IOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    TRANSMISSION,
    barycentric_grid,
)
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.vdb import openvdb_module
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.files import write_panorama
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.frame_export import export_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.paper_scenes.frame_import import import_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from mathutils import Matrix

from tests.model.published import frames
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine import f12


@pytest.fixture
def report(scene):
    return Report()


@pytest.fixture
def frame(tmp_path):
    """A folder with a frame that has everything, its environment and volume included."""
    folder = frames.write(tmp_path / "frame", environment=True, volume=True)
    (folder / "external").mkdir()
    write_panorama(folder / "external" / "sky.exr", panorama())
    write_smoke(folder / "external" / "smoke.vdb")
    return folder


def panorama() -> np.ndarray:
    y, x = np.mgrid[:256, :512] / 256
    return np.stack([1 + np.sin(np.pi * x), 1 + y, 0.5 + 0 * x], -1).astype(np.float32)


def smoke() -> np.ndarray:
    """(32, 32, 32) density by x, y, z: thick in a corner block, thin elsewhere, none in most."""
    density = np.full((32,) * 3, 1e-7, np.float32)
    density[:8, 4:16, 20:28], density[8:12, 4:16, 20:28] = 1, 0.75
    return density


def write_smoke(file) -> None:
    openvdb = openvdb_module()
    grid = openvdb.FloatGrid()
    grid.copyFromArray(smoke())
    grid.name, grid.transform = "density", openvdb.createLinearTransform(voxelSize=1 / 32)
    grid.transform.postTranslate((-15.5 / 32,) * 3)
    openvdb.write(str(file), grids=[grid])


def shown(imported, report=None, **options):
    """The RenderScene and the View of a scene, as its own settings and other options of a conversion have it."""
    bpy.context.window.scene = imported
    depsgraph, ours = bpy.context.evaluated_depsgraph_get(), imported.renderformer_v2
    view = convert_camera(depsgraph, imported.render.resolution_x, imported.render.resolution_y, None)
    return convert(depsgraph, view, ConversionOptions(ours.token_budget, ours.max_edge, ours.as_is, **options),
                   report or Report()), view


def tile_at(scene, corner) -> np.ndarray:
    """(11, 32, 32) of the square whose corner is there."""
    low = scene.triangles.min(axis=1)
    return scene.tiles[scene.tile_index[np.linalg.norm(low - corner, axis=1).argmin()]].astype(np.float32)


def at(index):
    return -0.4 + 0.1 * index, 0.05 * index, 0.1 * index


def test_a_frame_is_shown_with_its_camera_and_as_it_is(frame, report):
    imported = import_frame(frame, report, 256)
    converted, view = shown(imported)
    assert report.entries == [report.entries[0]] and "latent" in report.lines()[0]
    assert (view.width, view.height) == (256, 256) and len(converted) == 14
    np.testing.assert_allclose(view.focal, 128 / np.tan(np.radians(37.5) / 2), rtol=1e-5)
    back = np.array(frames.CAMERAS[0]["position"]) - frames.CAMERAS[0]["look_at"]
    np.testing.assert_allclose(view.camera_to_world[:3, 2], back / np.linalg.norm(back), atol=1e-6)
    np.testing.assert_allclose(view.camera_to_world[:3, 3], frames.CAMERAS[0]["position"], atol=1e-6)
    normalization = Normalization.of(converted)
    assert (normalization.scale, normalization.exposure) == (1, 1) and not normalization.center.any()
    np.testing.assert_allclose(converted.normals, np.tile((0, 0, 1), (14, 3, 1)), atol=1e-3)


def test_every_camera_has_a_frame(frame, report):
    imported = import_frame(frame, report)
    bpy.context.window.scene = imported
    imported.frame_set(2)
    np.testing.assert_allclose(imported.camera.matrix_world.translation, frames.CAMERAS[1]["position"], atol=1e-6)
    assert (imported.frame_start, imported.frame_end) == (1, 2)


def test_homogeneous_materials_of_a_frame_keep_their_numbers(frame, report):
    converted, _ = shown(import_frame(frame, report))
    metal, glass = tile_at(converted, at(1))[:, 0, 0], tile_at(converted, at(2))[:, 0, 0]
    np.testing.assert_allclose(metal[BASE_COLOR], frames.METALLIC["base_color"], atol=1e-3)
    np.testing.assert_allclose([metal[METALLIC], metal[ROUGHNESS], metal[IOR], metal[TRANSMISSION]],
                               [0.25, 0.4, 1.5, 0], atol=1e-3)
    np.testing.assert_allclose([glass[METALLIC], glass[ROUGHNESS], glass[IOR], glass[TRANSMISSION]],
                               [0, 0.1, 1.45, 1], atol=1e-3)
    light = converted.is_light
    np.testing.assert_allclose(converted.emission[light], [frames.RADIANCE] * 2, rtol=1e-5)
    assert {obj.name for obj in bpy.context.scene.objects if not obj.visible_camera} == {"lamp"}


def lobes_at(scene, corner) -> np.ndarray:
    """(7, 32, 32), as `tile_at`."""
    low = scene.triangles.min(axis=1)
    return scene.two_lobes[scene.tile_index[np.linalg.norm(low - corner, axis=1).argmin()]].astype(np.float32)


def test_diffuse_and_specular_of_a_frame_stay_apart_for_the_published_network(frame, report):
    converted, _ = shown(import_frame(frame, report))
    floor = lobes_at(converted, at(0))
    expected = [*frames.DIFFUSE["diffuse"], *frames.DIFFUSE["specular"], frames.DIFFUSE["roughness"]]
    np.testing.assert_allclose(floor, np.broadcast_to(np.reshape(expected, (7, 1, 1)), floor.shape), atol=1e-3)
    cloth = lobes_at(converted, at(4))
    assert np.ptp(cloth[0]) > 0.3 and np.ptp(cloth[6]) > 0.2 and not lobes_at(converted, at(1)).any()
    assert np.ptp(converted.two_lobes[converted.tile_index[converted.is_light]]) == 0


@pytest.mark.parametrize("keeps_lobes", [False, True])
def test_one_surface_in_place_of_two_lobes_is_reported_where_the_network_does_not_see_both(frame, report, keeps_lobes):
    imported = import_frame(frame, report)
    conversion = Report()
    shown(imported, conversion, keeps_lobes=keeps_lobes)
    replaced = {it.name for it in conversion.entries if "two shaders" in it.message}
    assert replaced == (set() if keeps_lobes else {"floor", "cloth"})


def test_what_a_frame_wants_beyond_its_meshes_is_reported(frame, report):
    content = json.loads((frame / "scene_config.json").read_text())
    content["wall_holes"] = {"floor": [{"center": [0.1, 0.2, 0.3]}]}
    content["objects"]["metal"]["material"]["rand_tri_diffuse_seed"] = 7
    (frame / "scene_config.json").write_text(json.dumps(content))
    import_frame(frame, report)
    remarks = {(it.kind, it.name): it.message for it in report.entries}
    assert "wall_holes" in remarks["skipped", "floor"]
    assert "rand_tri_diffuse_seed" in remarks["approximated", "metal"]
    assert read_frame(frame).wall_holes == content["wall_holes"]


def test_a_measured_material_is_its_latent(frame, report):
    converted, _ = shown(import_frame(frame, report))
    rows = np.flatnonzero(converted.latents.any(axis=1))
    np.testing.assert_allclose(converted.latents[rows], [frames.LATENT], atol=1e-6)
    assert (np.isin(converted.tile_index, rows)).sum() == 2


def test_maps_are_linear_numbers_on_the_tiles(frame, report):
    converted, _ = shown(import_frame(frame, report))
    cloth = tile_at(converted, at(4))
    w = barycentric_grid()
    first = np.tensordot(w, np.array([(0, 0), (1, 0), (1, 1)], float), 1)  # UVs of the triangle that tile_at finds
    x = np.clip(first[..., 0], 0, 1)
    inside = (w >= 0).all(-1) & (x > 0.02) & (x < 0.98)  # images repeat at their borders
    np.testing.assert_allclose(cloth[NORMAL.start][inside], (2 * (128 + 20 * x) / 255 - 1)[inside], atol=0.02)
    height = 2 * (60 + 20 * 4 + 100 * x) / 255 - 1
    np.testing.assert_allclose(cloth[HEIGHT][inside], height[inside], atol=0.02)
    rust = tile_at(converted, at(5))
    np.testing.assert_allclose(rust[BASE_COLOR][0][inside], (200 * x / 255)[inside], atol=0.02)
    np.testing.assert_allclose(rust[METALLIC][inside], ((80 + 100 * x) / 255)[inside], atol=0.02)


def test_the_environment_is_turned_as_in_the_research_code(frame, report):
    converted, _ = shown(import_frame(frame, report))
    expected = rotate_environment(panorama(), np.float32((0, 20, 30)), 2.0)
    assert np.abs(converted.environment - expected).mean() < 0.01


def test_a_volume_of_a_frame_is_where_its_cells_are(frame, report):
    volumes = shown(import_frame(frame, report))[0].volumes
    full = volumes.density.mean(axis=1) > 0.6
    np.testing.assert_allclose(volumes.scale, 0.5, rtol=0.1)
    turn = np.array(Matrix.Rotation(np.radians(30), 3, "Z") @ Matrix.Rotation(np.radians(20), 3, "Y")
                    @ Matrix.Rotation(np.radians(10), 3, "X"))
    local = (volumes.position[full].astype(float) - (0.1, -0.2, 0.3)) @ turn / 0.5
    thick = np.argwhere(smoke() > 0.5)
    np.testing.assert_allclose(local.min(axis=0), (thick.min(axis=0) + 2 - 15.5) / 32, atol=0.02)
    np.testing.assert_allclose(local.max(axis=0), (thick.max(axis=0) - 1 - 15.5) / 32, atol=0.02)
    np.testing.assert_allclose(volumes.scattering[0] / volumes.scattering[0, 0],
                               np.array(frames.SCATTERING) / frames.SCATTERING[0], rtol=0.01)


def test_what_is_missing_in_a_frame_is_named_and_the_rest_is_shown(tmp_path, report):
    folder = frames.write(tmp_path / "frame", environment=True, volume=True)
    (folder / "split" / "metal.obj").unlink()
    (folder / "split" / "rust" / "roughness.png").unlink()
    imported = import_frame(folder, report)
    said = "\n".join(report.lines())
    for name in ("split/metal.obj", "split/rust/roughness.png", "external/sky.exr", "external/smoke.vdb"):
        assert f"{name} is not in" in said
    converted, _ = shown(imported)
    assert len(converted) == 12 and converted.environment is None and converted.volumes is None


def test_a_frame_that_cannot_be_used_leaves_no_scene(tmp_path, report):
    before = set(bpy.data.scenes)
    with pytest.raises(SceneError, match="no prepared frame"):
        import_frame(tmp_path, report)
    folder = frames.write(tmp_path / "frame")
    text = (folder / "scene_config.json").read_text().replace('"look_at": [0.0, 0.0, 0.05]',
                                                              '"look_at": [0.1, -2.0, 0.3]')
    (folder / "scene_config.json").write_text(text)
    with pytest.raises(SceneError, match="looks nowhere"):
        import_frame(folder, report)
    assert set(bpy.data.scenes) == before


def test_a_frame_goes_round(frame, report, tmp_path):
    imported = import_frame(frame, report)
    bpy.context.window.scene = imported
    out = tmp_path / "out"
    export_frame(imported, out, report)
    assert not any("replaced by one" in line for line in report.lines())
    before, after = read_frame(frame), read_frame(out)
    assert find_missing_files(after, out) == [] and imported.render.engine == "RENDERFORMER_V2"
    assert set(after.objects) == set(before.objects) and after.name == before.name
    for key, it in before.objects.items():
        found = after.objects[key].material
        assert found.kind == it.material.kind and found.has_height == it.material.has_height
        for name, value in it.material.numbers.items():
            np.testing.assert_allclose(found.numbers[name], value, atol=2e-3, err_msg=f"{key} {name}")
        np.testing.assert_allclose(found.emission, it.material.emission, rtol=1e-5)
        one, other = (read_obj(folder / side.objects[key].mesh) for folder, side in ((frame, before), (out, after)))
        for values in ("vertices", "normals", "uv"):
            np.testing.assert_allclose(np.sort(getattr(one, values), axis=0), np.sort(getattr(other, values), axis=0),
                                       atol=1e-3 if values == "normals" else 1e-5)
    assert after.objects["lamp"].is_light
    for name, other in (("cloth", "diffuse"), ("cloth", "specular"), ("cloth", "roughness"), ("cloth", "normal"),
                        ("cloth", "height"), ("rust", "base_color"), ("rust", "metallic"), ("rust", "normal")):
        given = imread(frame / "split" / name / f"{other}.png").astype(int)
        found = imread(out / "split" / name / f"{other.replace('_', '')}.png").astype(int)
        assert np.abs(given - found)[1:-1, 1:-1].max() <= 1, f"{name} {other}"
    np.testing.assert_allclose(np.load(out / after.objects["measured"].material.latent), frames.LATENT, atol=1e-6)
    for one, other in zip(before.cameras, after.cameras, strict=True):
        np.testing.assert_allclose(other.position, one.position, atol=1e-6)
        np.testing.assert_allclose(other.fov, one.fov, rtol=1e-4)
    again, _ = shown(import_frame(out, Report()))
    first, _ = shown(imported)
    assert np.abs(again.environment - first.environment).mean() < 0.005
    assert abs(len(again.volumes) - len(first.volumes)) <= 2
    for values in ("position", "scattering"):
        np.testing.assert_allclose(getattr(again.volumes, values).mean(axis=0),
                                   getattr(first.volumes, values).mean(axis=0), rtol=0.05, atol=0.01)


def test_a_scene_made_in_blender_becomes_a_frame(scene, report, tmp_path):
    """Lamps, a default material, and one whose texture is no function of UVs."""
    f12.cube(scene, of=f12.material("Red", (0.8, 0.05, 0.05)))
    noisy = f12.material("Noisy")
    noise = noisy.node_tree.nodes.new("ShaderNodeTexNoise")
    noisy.node_tree.links.new(noise.outputs["Color"], noisy.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    f12.cube(scene, "A cube/with: a name", (3, 0, 0), of=noisy)
    f12.sun(scene)
    scene.render.resolution_x = scene.render.resolution_y = 64
    export_frame(scene, tmp_path / "out", report)
    frame = read_frame(tmp_path / "out")
    assert find_missing_files(frame, tmp_path / "out") == []
    red = frame.objects["Cube"].material
    assert red.kind == "homo_metallic_roughness_transmission"
    np.testing.assert_allclose([red.numbers["ior"], red.numbers["transmission_weight"]], [1.32943, 0], atol=2e-3)
    np.testing.assert_allclose(red.numbers["base_color"], (0.8, 0.05, 0.05), atol=1e-3)
    lights = [it for it in frame.objects.values() if it.is_light]
    assert lights and all(max(it.material.emission) > 1 for it in lights)
    assert "A_cube_with__a_name" in frame.objects and "varies by more than UVs" in "\n".join(report.lines())
    assert frame.environment is not None
    assert not any(scene.name.startswith("RenderFormer") for scene in bpy.data.scenes)


def test_a_folder_that_holds_something_is_not_written_to(scene, report, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SceneError, match="is not empty"):
        export_frame(scene, tmp_path, report)


def test_the_menus_import_and_export(frame, tmp_path):
    assert bpy.ops.import_scene.renderformer_v2(filepath=str(frame / "scene_config.json"), resolution=128) == {
        "FINISHED"}
    imported = bpy.context.window.scene
    assert imported.name == "every-type" and imported.render.resolution_x == 128
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "out")) == {"FINISHED"}
    assert (tmp_path / "out" / "scene_config.json").is_file()
    shutil.rmtree(frame / "split")
    with pytest.raises(RuntimeError, match="no prepared frame"):
        bpy.ops.import_scene.renderformer_v2(filepath=str(tmp_path / "scene_config.json"))


@pytest.fixture
def bundle(tmp_path):
    return write_bundle(tmp_path / "renderformer-v2", tiny_published_config())


def test_f12_shows_an_imported_frame_with_published_weights(frame, report, tmp_path, bundle):
    imported = import_frame(frame, report, 64)
    bpy.context.window.scene = imported
    ours = imported.renderformer_v2
    ours.weights_source, ours.weights_folder, ours.guide_samples, ours.precision = "FOLDER", str(bundle), 1, "fp32"
    picture = f12.press_f12(imported, tmp_path)["ViewLayer.Combined"]
    (layer,) = last_render.last_frame
    assert picture.shape == (64, 64, 4) and np.isfinite(picture).all() and not layer.error
    assert layer.triangles == 14 and layer.weights == str(bundle)
    assert 0 < picture[..., 3].mean() < 1  # nothing is behind the squares


def test_the_menu_writes_h5_scenes_and_reads_them_again(frame, report, tmp_path, bundle):
    imported = import_frame(frame, report, 64)
    bpy.context.window.scene = imported
    with pytest.raises(RuntimeError, match="latents of the published weights"):
        bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "scene.h5"))
    imported.renderformer_v2.weights_source, imported.renderformer_v2.weights_folder = "FOLDER", str(bundle)
    assert bpy.ops.export_scene.renderformer_v2(filepath=str(tmp_path / "scene.h5")) == {"FINISHED"}
    assert bpy.ops.import_scene.renderformer_v2(filepath=str(tmp_path / "scene.h5")) == {"FINISHED"}
    again = bpy.context.window.scene
    assert again != imported and sum(len(it.data.polygons) for it in again.objects if it.type == "MESH") == 14
    np.testing.assert_allclose(again.camera.matrix_world, imported.camera.matrix_world, atol=1e-5)
    light = again.objects["Light"].data.materials[0].node_tree.nodes["Principled BSDF"]
    np.testing.assert_allclose(light.inputs["Emission Strength"].default_value, max(frames.RADIANCE), rtol=1e-3)
