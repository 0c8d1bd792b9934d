# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluation measures what it says, on samples and on .blend files, and shows it on one page."""
import json
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from skimage.io import imread

from renderformer_v2.model.renderer import Renderer
from tests.model.samples import floor_scene, floor_view
from tools.common.metrics import AMPLIFIED, add_error_pictures, compare, psnr
from tools.common.render_process import run_render_cached
from tools.datagen.sample_files import save_sample

ROOT = Path(__file__).parents[2]
SCENE = """
import os, sys, bpy
bpy.ops.wm.read_homefile(use_factory_startup=True)
render, scene = bpy.context.scene.render, bpy.context.scene
render.resolution_x, render.resolution_y, scene.cycles.samples = 48, 40, 4
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
sys.stdout.flush(), os._exit(0)
"""


def evaluate(folder: Path, report: Path, *options: str) -> dict:
    done = subprocess.run([sys.executable, "-m", "tools.evaluate", str(folder), "-o", str(report), *options], cwd=ROOT,
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed == json.loads((report / "report.json").read_text())
    return printed


@pytest.fixture(scope="module")
def cube(tmp_path_factory) -> Path:
    """A file with the scene that Blender starts with."""
    path = tmp_path_factory.mktemp("cube") / "a cube.blend"
    subprocess.run([sys.executable, "-c", SCENE, str(path)], check=True, capture_output=True, timeout=600)
    return path


def test_metrics_of_known_differences():
    picture = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    assert compare(picture, picture) == pytest.approx(
        {"psnr": 100.0, "ssim": 1.0, "flip": 0.0, "hdr_flip": 0.0}, abs=1e-4)
    assert psnr(np.full((4, 4, 3), 0.5), np.full((4, 4, 3), 0.6)) == pytest.approx(20.0)


def test_a_black_reference_can_be_compared_with():
    black = np.zeros((16, 16, 3), np.float32)
    picture = black.copy()
    picture[:4] = 0.5
    assert compare(black, black)["hdr_flip"] == 0 and compare(picture, black)["hdr_flip"] == 0.25


def test_a_sample_whose_reference_is_our_own_picture_is_perfect_and_a_darker_one_is_not(tmp_path):
    scene, (view, guides) = floor_scene(), floor_view()
    picture = Renderer().encode(scene).view(view, guides)
    for seed, factor in ((1, 1.0), (2, 0.25)):
        combined = np.concatenate([picture * factor, guides.alpha[..., None]], axis=-1)
        save_sample(tmp_path / f"scene_{seed:08d}.npz", scene, [view], [guides], [{"combined": combined}])
    scenes = evaluate(tmp_path, tmp_path / "report")["scenes"]
    same, darker = (scenes[f"scene_{seed:08d}"] for seed in (1, 2))
    assert same["psnr"] > 35 and darker["psnr"] < same["psnr"] - 5 and darker["flip"] > same["flip"]


@pytest.mark.slow
def test_blend_files_are_rendered_by_both_engines(tmp_path, cube):
    shutil.copy(cube, tmp_path)
    scene = evaluate(tmp_path, tmp_path / "report")["scenes"]["a cube"]
    assert scene["psnr"] > 15 and scene["cycles_seconds"] > 0
    equal = scene["beside"]["cycles_equal"]
    assert 1 <= equal["samples"] <= 4 and equal["seconds"] > 0 and equal["psnr"] > scene["psnr"]
    assert scene["beside"]["network_and_rays"]["psnr"] > 15
    page = Page(tmp_path / "report")
    assert [Path(file).stem for file in page.pictures()] == KINDS
    assert imread(tmp_path / "report" / page.pictures()[0]).shape == (40, 48, 3)


@pytest.mark.slow
def test_cycles_with_chosen_samples_is_beside_a_reference_that_is_not_clamped(tmp_path, cube):
    shutil.copy(cube, tmp_path)
    found = evaluate(tmp_path, tmp_path / "report", "--cycles", "1", "2", "--reference", "3")
    beside = found["scenes"]["a cube"]["beside"]
    assert set(beside) == {"cycles_1", "cycles_2", "network_and_rays", "transformer_alone"}
    assert found["mean"]["cycles_2"]["seconds"] > 0
    assert "Cycles, 2 samples" in Page(tmp_path / "report").cells


@pytest.mark.slow
def test_a_reference_is_rendered_once_for_the_same_file_and_samples(tmp_path, cube):
    scene, output = Path(shutil.copy(cube, tmp_path)), tmp_path / "a cube.cycles.exr"
    options = "--engine", "cycles", "--samples"
    first = run_render_cached(scene, output, *options, 2)
    written = output.stat().st_mtime_ns
    assert first["samples"] == 2 and run_render_cached(scene, output, *options, 2) == first
    assert output.stat().st_mtime_ns == written
    assert run_render_cached(scene, output, *options, 1)["samples"] == 1 and output.stat().st_mtime_ns != written


def test_a_file_that_cannot_be_rendered_is_named_without_a_traceback_and_what_was_done_before_stays(tmp_path):
    (tmp_path / "broken.blend").write_bytes(b"not a scene")
    view, guides = floor_view()
    combined = np.concatenate([guides.diffuse_color, guides.alpha[..., None]], axis=-1)
    save_sample(tmp_path / "scene_00000001.npz", floor_scene(), [view], [guides], [{"combined": combined}])
    done = subprocess.run([sys.executable, "-m", "tools.evaluate", str(tmp_path), "-o", str(tmp_path / "report")],
                          cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and "broken.blend" in done.stderr and "Traceback" not in done.stderr
    assert list(json.loads((tmp_path / "report" / "report.json").read_text())["scenes"]) == ["scene_00000001"]


KINDS = ["1-ours", "1-reference", "1-equal", "1-difference", "1-flip"]


class Page(HTMLParser):
    """What a browser is told to show and to fetch."""

    def __init__(self, report: Path):
        super().__init__()
        self.tags, self.cells, self.text = [], [], None
        self.source = (report / "report.html").read_text("utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag in ("th", "td"):
            self.cells.append("")

    def handle_data(self, data):
        if self.cells:
            self.cells[-1] += data.strip()

    def all(self, tag: str, attribute: str) -> list[str]:
        return [unquote(found[attribute]) for name, found in self.tags if name == tag and attribute in found]

    def pictures(self) -> list[str]:
        return self.all("img", "src")


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    command = [sys.executable, "-m", "tools.datagen", str(folder), "--scenes", "2", "--first-seed", "900000", "--views",
               "2", "--resolution", "32", "--samples", "4", "--equal", "1", "--processes", "1"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=600)
    evaluate(folder, folder / "report")
    return folder / "report"


@pytest.mark.slow
def test_the_page_shows_every_view_of_every_scene_beside_cycles(report):
    page = Page(report)
    scenes = json.loads((report / "report.json").read_text())["scenes"]
    views = [f"pictures/{scene}/{view}{kind[1:]}.png" for scene in scenes for view in (1, 2) for kind in KINDS]
    assert page.pictures() == views and len(views) == 20
    assert {file.relative_to(report).as_posix() for file in report.rglob("*.png")} == set(views)
    assert {imread(report / file).shape for file in views} == {(32, 32, 3)}
    assert page.all("section", "id") == page.all("tr", "data-scene") == list(scenes)
    assert {link.removeprefix("#") for link in page.all("a", "href")} == set(scenes)


@pytest.mark.slow
def test_the_page_has_the_figures_of_the_report(report):
    page, found = Page(report), json.loads((report / "report.json").read_text())
    assert {"PSNR, dB", "SSIM", "FLIP", "time, s", "triangles", "without the network",
            "network and rays", "rays alone", "transformer alone", "traced light alone",
            "Cycles, equal time"} <= set(page.cells)
    for of in (found["mean"], *found["scenes"].values()):
        assert f"{of['psnr']:.2f}" in page.cells and f"{of['flip']:.4f}" in page.cells
    assert f"{found['mean']['worst_psnr']:.2f}" in page.cells
    assert f"{found['mean']['cycles_equal']['ssim']:.4f}" in page.cells


@pytest.mark.slow
def test_the_page_needs_nothing_from_elsewhere(report):
    page = Page(report)
    assert "//" not in page.source.replace("  // ", "") and "@import" not in page.source
    assert not {"link", "iframe", "object"} & {tag for tag, _ in page.tags} and not page.all("script", "src")


def test_difference_and_flip_show_where_pictures_differ():
    reference = np.full((32, 32, 3), 0.5, np.float32)
    ours = reference.copy()
    ours[8:24, 8:24] += 0.1
    shown = add_error_pictures({"ours": ours, "reference": reference})
    assert shown["difference"][16, 16] == pytest.approx(0.1 * AMPLIFIED, abs=1e-4)
    assert shown["difference"][0, 0] == pytest.approx(0)
    assert shown["flip"][16, 16].sum() > shown["flip"][0, 0].sum() + 0.3
    perfect = add_error_pictures({"ours": reference, "reference": reference})
    assert perfect["flip"] == pytest.approx(np.broadcast_to(perfect["flip"][0, 0], (32, 32, 3)))
