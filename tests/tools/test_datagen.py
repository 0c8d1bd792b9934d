# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.datagen` makes samples that fit together, always the same for a seed, and goes on where it was."""
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderformer_v2.model.camera import view_rays
from renderformer_v2.model.geometry import latlong_uv
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE, IOR, TILE_SIZE, TRANSMISSION
from tests.model.samples import floor_scene, floor_view
from tools.datagen.__main__ import main, share_out
from tools.datagen.sample_files import STORED_TILE, load_sample, sample_path, sample_paths, save_arrays, save_sample

ROOT = Path(__file__).parents[2]
SEEDS = (8, 9)  # of the mixed profile: full and simple


def generate(folder: Path, seeds=SEEDS, profile: str = "mixed") -> str:
    command = [sys.executable, "-m", "tools.datagen", folder, "--first-seed", seeds[0], "--scenes", len(seeds),
               "--views", 2, "--resolution", 32, "--samples", 16, "--equal", 16, "--profile", profile]
    done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    generate(folder)
    return folder


@pytest.mark.parametrize("seed", SEEDS)
def test_scene_cameras_guides_and_passes_of_a_sample_belong_together(folder, seed):
    scene, views, guides, passes = load_sample(sample_path(folder, seed))
    scene.validate()
    assert 150 <= len(scene) <= 3072 and scene.tiles.shape[-1] == TILE_SIZE
    assert scene.is_light.any() or scene.environment is not None
    assert scene.environment is None or scene.environment.shape == ENVIRONMENT_SHAPE
    for view, guide, light in zip(views, guides, passes, strict=True):
        hit = (guide.hit_triangle >= 0) & (guide.alpha > 0.99)
        assert hit.mean() > 0.2
        weights = np.concatenate([guide.hit_barycentric, 1 - guide.hit_barycentric.sum(-1, keepdims=True)], axis=-1)
        on_triangle = (scene.triangles[guide.hit_triangle] * weights[..., None]).sum(axis=-2)
        assert np.median(np.linalg.norm(on_triangle - guide.position, axis=-1)[hit]) < 2e-3

        to_camera = np.linalg.inv(view.camera_to_world.astype(np.float64))
        seen = guide.position[hit] @ to_camera[:3, :3].T + to_camera[:3, 3]
        rows, columns = np.nonzero(hit)
        assert np.median(np.abs(view.principal[0] - seen[:, 0] / seen[:, 2] * view.focal[0] - columns - 0.5)) < 0.1
        assert np.median(np.abs(view.principal[1] + seen[:, 1] / seen[:, 2] * view.focal[1] - rows - 0.5)) < 0.1

        total = light["emission"] + light["volume_direct"] + light["volume_indirect"]
        for lobe in ("diffuse", "glossy", "transmission"):
            total = total + getattr(guide, f"{lobe}_color") * (light[f"{lobe}_direct"] + light[f"{lobe}_indirect"])
        # "combined" is denoised and the others are not: compare what denoising keeps.
        assert total.mean() == pytest.approx(light["combined"][..., :3].mean(), rel=0.25)
        assert not np.array_equal(light["equal"], light["combined"])  # as many samples: their noise is another


def test_simple_scenes_have_neither_glass_nor_volumes_nor_textures(folder):
    scene = load_sample(sample_path(folder, 9), tile_size=STORED_TILE).scene
    assert scene.volumes is None and not scene.tiles[:, TRANSMISSION].any()
    assert (scene.tiles[:, IOR] >= 1).all()
    assert np.ptp(scene.tiles.astype(np.float32), axis=(2, 3)).max() == 0


def test_a_second_run_keeps_finished_scenes_and_makes_a_lost_one_again_just_the_same(folder):
    kept, lost = (sample_path(folder, seed) for seed in SEEDS[::-1])
    written, before = kept.stat().st_mtime_ns, dict(np.load(lost))
    lost.unlink()
    assert kept.name not in generate(folder)
    assert kept.stat().st_mtime_ns == written
    after = np.load(lost)
    assert set(after.files) == set(before)
    for name in before:
        np.testing.assert_allclose(after[name].astype(float), before[name].astype(float), atol=1e-3, err_msg=name)


def test_shares_that_only_one_view_has_are_all_in_the_others(tmp_path):
    view, guides = floor_view(32, 32)
    some = {name: np.full_like(guides.alpha, 0.5) for name in ("matte_share", "glossy_kept", "normal_variance")}
    passes = {"combined": np.zeros((32, 32, 4), np.float32)}
    save_sample(tmp_path / "scene.npz", floor_scene(), [view] * 2, [replace(guides, **some), guides], [passes] * 2)
    first, second = load_sample(tmp_path / "scene.npz").guides
    assert all((getattr(first, name) == 0.5).all() for name in some)
    assert (second.matte_share == 1).all() and (second.glossy_kept == 1).all() and not second.normal_variance.any()


def test_a_killed_write_leaves_no_sample(tmp_path):
    class Broken:
        def __array__(self, *_, **__):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_arrays(sample_path(tmp_path, 1), {"fine": np.zeros(3), "broken": Broken()})
    assert sample_paths(tmp_path) == []


def test_no_number_of_threads_means_every_core():
    program = ("import bpy, sys; from tools.datagen import render_sample; render_sample.prepare(0); "
               "sys.stderr.write(f'threads={bpy.context.scene.render.threads}'); "
               "from tools.extension import leave; leave(0)")
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert f"threads={os.cpu_count()}" in done.stderr


def test_a_process_that_is_killed_is_a_failure(monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", lambda command, spawn=subprocess.Popen: spawn(
        [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"]))
    assert share_out(2, 1) == 1


def test_a_wide_scene_keeps_to_its_own_budget(tmp_path):
    generate(tmp_path, seeds=(3,), profile="wide")
    scene, views, _, passes = load_sample(sample_path(tmp_path, 3))
    scene.validate()
    assert 100 < len(scene) <= 16384 and {view.width for view in views} == {32} and len(passes) == 2


@pytest.mark.slow
def test_a_sky_lights_the_tokens_as_it_is_seen(tmp_path):
    generate(tmp_path, seeds=(4,), profile="wide")
    scene, views, guides, _ = load_sample(sample_path(tmp_path, 4))
    height, width, _ = ENVIRONMENT_SHAPE
    for view, guide in zip(views, guides, strict=True):
        u, v = np.moveaxis(latlong_uv(view_rays(view)[1]), -1, 0)
        there = scene.environment[((1 - v) * height).astype(int).clip(0, height - 1), (u * width).astype(int) % width]
        sky = (guide.alpha == 0) & (guide.environment.min(axis=-1) > 0.05)
        assert sky.mean() > 0.05
        np.testing.assert_allclose(np.median(there[sky] / guide.environment[sky], axis=0), 1, atol=0.01)


@pytest.mark.parametrize("option", ["--scenes", "--views", "--samples", "--resolution", "--processes", "--threads"])
@pytest.mark.parametrize("value", ["-1", "x"])
def test_numbers_that_make_no_sense_are_explained(monkeypatch, capsys, tmp_path, option, value):
    monkeypatch.setattr(sys, "argv", ["datagen", str(tmp_path), "--scenes", "1", "--first-seed", "1", option, value])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert f"{option}: {value}: expected a whole number from" in capsys.readouterr().err


def test_a_full_disk_ends_the_run_with_one_line(tmp_path):
    command = f"ulimit -f 8; exec {sys.executable} -m tools.datagen {tmp_path} --scenes 2 --first-seed 1 " \
              "--samples 1 --profile simple --resolution 32 --views 1 --processes 1"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, timeout=600)
    said = [line for line in done.stderr.splitlines() if "cannot be written" in line]
    assert done.returncode == 1 and said == [f"{tmp_path} cannot be written: File too large"]
    assert "Traceback" not in done.stderr and list(tmp_path.iterdir()) == []


def test_a_program_with_blender_ends_when_it_fails():
    program = ("from tools import extension; from tools.datagen import render_sample\n"
               "def main():\n    render_sample.prepare(0)\n    raise KeyError('odd')\n"
               "extension.run(main)")
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and "KeyError: 'odd'" in done.stderr
