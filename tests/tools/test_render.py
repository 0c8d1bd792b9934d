# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.render`: wrong arguments, odd .blend files, and a process that always ends."""
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread

from renderformer_v2.model.published.h5 import read_h5
from tests.model.published.bundles import tiny_published_config, write_bundle
from tools.benchmark import ring
from tools.common.metrics import compare
from tools.common.pictures import read_pass
from tools.common.tone_mapping import tone_mapped
from tools.extension import ROOT
from tools.render import __main__ as render
from tools.render.comparison import LEAST_WIDTH


def command(*arguments) -> list[str]:
    return [sys.executable, "-m", "tools.render", *map(str, arguments)]


def run(*arguments, stdout=subprocess.PIPE) -> subprocess.CompletedProcess:
    return subprocess.run(command(*arguments), cwd=ROOT, stdout=stdout,
                          stderr=subprocess.PIPE, text=True, timeout=600)


@pytest.mark.parametrize("arguments, message", [
    (["--resolution", "0x0"], "--resolution: 0: "), (["--resolution", "64x-1"], "--resolution: -1: "),
    (["--resolution", "64"], "--resolution: 64: expected WIDTHxHEIGHT"), (["--samples", "0"], "--samples: 0: "),
    (["--weights", ""], "--weights: expected rf2_small"), (["-o", "out.jpg"], "-o/--output: out.jpg: the suffix"),
    (["--export-h5", "scene.blend"], "--export-h5: scene.blend: the suffix must be one of .h5, .hdf5"),
])
def test_wrong_arguments_are_explained(monkeypatch, capsys, arguments, message):
    monkeypatch.setattr(sys, "argv", ["render", "scene.blend", "-o", "out.exr", *arguments])
    with pytest.raises(SystemExit, match="2"):
        render.main()
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("option, name", [("-o", "out.exr"), ("--export-h5", "out.h5")])
def test_an_output_that_cannot_be_written_is_said_before_the_work(tmp_path, monkeypatch, capfd, option, name):
    (tmp_path / "scene.blend").write_bytes(b"not opened")
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "folder" / name).mkdir(parents=True)
    for parent in ("file", "folder"):
        output = tmp_path / parent / name
        monkeypatch.setattr(sys, "argv", ["render", str(tmp_path / "scene.blend"), option, str(output)])
        assert render.main() == 1
        assert f"{output} cannot be written: " in capfd.readouterr().err


@pytest.fixture
def scene(tmp_path):
    """The open file's scene, a small room."""
    import bpy
    ring.build(ring.LEAST, 64)
    return bpy.context.scene


@pytest.fixture
def save(tmp_path):
    import bpy

    def save() -> Path:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
        return tmp_path / "scene.blend"
    return save


@pytest.fixture(scope="module")
def bundle(tmp_path_factory) -> Path:
    return write_bundle(tmp_path_factory.mktemp("weights") / "renderformer-v2", tiny_published_config())


@pytest.mark.parametrize("arguments", [["-o", "out.exr"], ["-o", "out.exr", "--engine", "cycles"],
                                       ["--export-h5", "out.h5"]])
def test_a_scene_without_an_enabled_view_layer_is_named(scene, save, tmp_path, bundle, arguments):
    scene.name = "Backstage"
    scene.view_layers[0].use = False
    arguments[1] = tmp_path / arguments[1]
    done = run(save(), *arguments, "--weights", bundle)
    assert done.returncode == 1
    assert 'no view layer of scene "Backstage" is enabled for rendering' in done.stderr
    assert done.stderr.count("\n") == 1 and not arguments[1].exists()


@pytest.mark.parametrize("left, message", [("nothing", "nothing to render"), ("fog", "only volumes")])
def test_a_scene_without_a_triangle_is_not_exported(scene, save, tmp_path, bundle, left, message):
    import bpy
    for item in list(scene.objects):
        if item is not scene.camera:
            bpy.data.objects.remove(item)
    scene.world = None
    if left == "fog":
        bpy.ops.mesh.primitive_cube_add()
        material = bpy.data.materials.new("Fog")
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.remove(nodes["Principled BSDF"])
        fog = nodes.new("ShaderNodeVolumePrincipled")
        material.node_tree.links.new(fog.outputs["Volume"], nodes["Material Output"].inputs["Volume"])
        bpy.context.object.data.materials.append(material)
    done = run(save(), "--export-h5", tmp_path / "out.h5", "--weights", bundle)
    assert done.returncode == 1 and message in done.stderr and "at least one triangle" in done.stderr
    assert not (tmp_path / "out.h5").exists()


@pytest.mark.slow
def test_a_sequence_needs_no_engine_and_keeps_no_scene_from_being_exported(scene, save, tmp_path, bundle):
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strips.new_image("Card", str(tmp_path / "card.png"), 1, 1)
    path = save()
    picture = run(path, "-o", tmp_path / "new" / "out.png")
    assert picture.returncode == 0, picture.stderr
    assert json.loads(picture.stdout)["triangles"] is None and (tmp_path / "new" / "out.png").is_file()
    exported = run(path, "--export-h5", tmp_path / "new" / "folder" / "out.h5", "--weights", bundle)
    assert exported.returncode == 0, exported.stderr
    assert len(read_h5(tmp_path / "new" / "folder" / "out.h5").triangles) >= ring.LEAST


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a full disk to try")
def test_the_process_ends_whatever_happens_after_blender_was_loaded(scene, save, tmp_path):
    scene.render.resolution_x = scene.render.resolution_y = 16
    with open("/dev/full", "w") as full:
        done = run(save(), "-o", tmp_path / "out.png", stdout=full)
    assert done.returncode == 1 and "No space left" in done.stderr


@pytest.mark.parametrize("name", ["out.exr", "out.png"])
def test_a_picture_that_does_not_fit_the_disk_is_said_and_the_old_one_kept(scene, save, tmp_path, name):
    path, output = save(), tmp_path / "pictures" / name
    output.parent.mkdir()
    output.write_bytes(b"yesterday's")
    limited = ["bash", "-c", 'ulimit -f 1; exec "$@"', "bash",
               *command(path, "-o", output, "--engine", "cycles", "--samples", "1")]
    done = subprocess.run(limited, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and done.stdout == "", done.stderr
    assert done.stderr == f"{output} cannot be written: the file came out incomplete, is the disk full?\n"
    assert output.read_bytes() == b"yesterday's" and list(output.parent.iterdir()) == [output]


@pytest.mark.slow
def test_several_view_layers_are_summed_and_told_apart(scene, save, tmp_path):
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.view_layers[0].name = "First"
    scene.view_layers.new("Second")
    done = run(save(), "-o", tmp_path / "out.png", "--threads", "1")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    first, second = found["layers"]
    assert (first["layer"], second["layer"]) == ("First", "Second") and first["triangles"] >= ring.LEAST - 2
    assert found["triangles"] == first["triangles"] + second["triangles"] and found["weights"] == first["weights"]
    assert found["seconds"]["Network"] == pytest.approx(first["seconds"]["Network"] + second["seconds"]["Network"])


@pytest.mark.parametrize("mapper", ["agx", "none"])
def test_a_tone_mapper_is_that_of_h5_scenes(scene, save, tmp_path, mapper):
    """Of a .blend file, such as an imported frame: the PNG is the EXR as that function shows it."""
    scene.render.dither_intensity = 0
    done = run(save(), "-o", tmp_path / "out.exr", "-o", tmp_path / "out.png", "--engine", "cycles", "--samples", 1,
               "--resolution", "8x8", "--tone-mapper", mapper)
    assert done.returncode == 0, done.stderr
    shown = imread(tmp_path / "out.png")[..., :3].astype(int)
    expected = tone_mapped(read_pass(tmp_path / "out.exr", "Combined", "RGB"), mapper)
    assert np.abs(shown - expected).max() <= 1 and shown.std() > 1


def test_one_view_layer_is_told_without_its_name(scene, save, tmp_path):
    scene.render.resolution_x = scene.render.resolution_y = 16
    done = run(save(), "-o", tmp_path / "out.png")
    found = json.loads(done.stdout)
    assert list(found) == ["scene", "engine", "seconds", "tokens", "triangles", "report", "output", "size", "weights",
                           "device"]
    assert found["size"] == [16, 16] and "Network" in found["seconds"] and found["seconds"]["total"] > 0


@pytest.mark.parametrize("arguments, message", [
    (["--sheet", "sheet.png"], "are for --beside-cycles"), (["--reference-samples", "4"], "are for --beside-cycles"),
    (["--beside-cycles", "--engine", "cycles"], "is for pictures of RenderFormer-V2"),
    (["--beside-cycles", "--sheet", "sheet.jpg"], "--sheet: sheet.jpg: the suffix must be one of .png"),
])
def test_a_comparison_needs_two_engines(monkeypatch, capsys, arguments, message):
    monkeypatch.setattr(sys, "argv", ["render", "scene.blend", "-o", "out.exr", *arguments])
    with pytest.raises(SystemExit, match="2"):
        render.main()
    assert message in capsys.readouterr().err


def test_a_reference_beside_the_picture_is_measured_and_shown_for_each_view_layer(scene, save, tmp_path):
    from skimage.io import imread
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.use_border, scene.render.border_max_x, scene.render.border_min_y = True, 0.5, 0.25
    scene.view_layers[0].name = "First"
    scene.view_layers.new("Second")
    sheet, output = tmp_path / "sheet.png", tmp_path / "out.exr"
    done = run(save(), "-o", output, "--beside-cycles", "--reference-samples", "4", "--sheet", sheet)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [layer["layer"] for layer in found["layers"]] == ["First", "Second"]
    for layer in found["layers"]:
        assert layer["reference_samples"] == 4 and layer["seconds"]["Cycles Reference"] > 0
        assert layer["comparison"]["psnr"] > 15 and 0 < layer["comparison"]["flip"] < 0.5
    for layer in found["layers"]:
        pair = (read_pass(output, name, "RGB", layer["layer"])[:24, :16] for name in ("Combined", "Cycles Reference"))
        assert layer["comparison"]["psnr"] == pytest.approx(compare(*pair)["psnr"], abs=0.01)
    assert imread(sheet).shape[1] > 4 * LEAST_WIDTH
