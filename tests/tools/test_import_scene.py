# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.import_scene` makes .blend files of prepared frames and H5 scenes."""
import json
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np

from renderformer_v2.model.published.h5 import write_h5
from renderformer_v2.model.published.pipeline import PublishedPipeline
from tests.model.published import frames
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.model.published.v1_scenes import MATERIAL, write_scene
from tests.model.samples import floor_scene, floor_view
from tools import import_scene

ROOT = Path(import_scene.__file__).parent.parent


def run(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "tools.import_scene", *map(str, arguments)], cwd=ROOT,
                          capture_output=True, text=True)


def test_a_frame_becomes_a_blend_file(tmp_path):
    import bpy
    folder = frames.write(tmp_path / "frame", environment=True)
    done = run(folder, "-o", tmp_path / "scene.blend", "--resolution", "128")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["scene"], said["triangles"], said["cameras"]) == ("every-type", 14, 2)
    assert any("external/sky.exr is not in" in line for line in said["report"])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert [scene.name for scene in bpy.data.scenes] == ["every-type"]
    assert all(Path(bpy.path.abspath(image.filepath)).is_file() for image in bpy.data.images if image.filepath)


def test_an_h5_scene_becomes_a_blend_file(tmp_path):
    import bpy
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    processed = PublishedPipeline(bundle, "cpu", None).process(floor_scene(), [floor_view()[0]])
    write_h5(tmp_path / "scene.h5", processed)
    done = run(tmp_path / "scene.h5", "-o", tmp_path / "scene.blend")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["triangles"] == len(processed.triangles) and "no shader can be read back" in said["report"][0]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    light = bpy.data.objects["Light"]
    assert len(light.data.polygons) == 1 and not light.visible_camera
    camera = bpy.context.scene.camera
    np.testing.assert_allclose(np.degrees(camera.data.angle), processed.fov[0], rtol=1e-4)
    np.testing.assert_allclose(camera.matrix_world, processed.camera_to_world[0], atol=1e-5)


def test_what_is_no_scene_is_refused_in_a_line(tmp_path):
    done = run(tmp_path, "-o", tmp_path / "scene.blend")
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "no prepared frame" in done.stderr


def test_a_scene_of_version_1_becomes_a_blend_file_with_its_random_colors_in_it(tmp_path):
    import bpy
    material = MATERIAL | {"rand_tri_diffuse_seed": 3, "random_diffuse_type": "per-triangle"}
    done = run(write_scene(tmp_path / "v1", material=material), "-o", tmp_path / "scene.blend")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["scene"], said["triangles"], said["report"]) == ("one cube", 12, [])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert sum(image.packed_file is not None for image in bpy.data.images) == 4
    image = next(image for image in bpy.data.images if "diffuse" in image.filepath)
    drawn = np.random.RandomState(3).randint(0, 256, (12, 3))
    colors = np.array(image.pixels).reshape(256, 256, 4)[-1, :12, :3] * 255
    assert {tuple(color) for color in colors.round().astype(int).tolist()} == {tuple(color) for color in drawn.tolist()}


def test_colors_of_an_h5_scene_of_version_1_become_shaders(tmp_path):
    import bpy
    triangles = floor_scene(2).triangles
    texture = np.zeros((len(triangles), 13, 32, 32), np.float16)
    texture[:, :7], texture[-1, 10:13] = np.float16([0.8, 0.4, 0.2, 0.1, 0.1, 0.1, 0.25])[:, None, None], 1000
    texture[:, :, np.add.outer(np.arange(32), np.arange(32)) > 32] = 0
    with h5py.File(tmp_path / "scene.h5", "w") as file:
        for key, values in {"triangles": triangles, "vn": np.tile((0.0, 0, 1), (len(triangles), 3, 1)), "fov": [40.0],
                            "texture": texture, "c2w": floor_view()[0].camera_to_world[None]}.items():
            file[key] = values
    done = run(tmp_path / "scene.h5", "-o", tmp_path / "scene.blend")
    assert done.returncode == 0 and json.loads(done.stdout)["report"] == [], done.stderr
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    nodes = bpy.data.objects["Surface"].active_material.node_tree.nodes
    inputs = next(node for node in nodes if node.bl_idname == "ShaderNodeGroup").inputs
    np.testing.assert_allclose(inputs["Diffuse"].default_value[:3], [0.8, 0.4, 0.2], atol=1e-3)
    np.testing.assert_allclose(inputs["Roughness"].default_value, 0.25)
    assert len(bpy.data.objects["Light"].data.polygons) == 1
