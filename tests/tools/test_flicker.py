# SPDX-License-Identifier: GPL-3.0-or-later
"""The measure of flicker sees what changes, not what moves; its command renders every frame once."""
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderformer_v2.model.camera import view_rays
from renderformer_v2.model.scene import View
from tests.model.samples import floor_view
from tools.benchmark import ring
from tools.common.pictures import read_pass
from tools.flicker.measure import Frame, measure_flicker, project_to_pixels

ROOT = Path(__file__).parents[2]
STEP = 0.13  # world units; about 2.8 pixels


def waves(position: np.ndarray) -> np.ndarray:
    """A texture with a period of about twelve pixels."""
    wave = np.sin(position[..., :1] * 11) * np.sin(position[..., 1:2] * 9 + 1)
    return (0.4 + 0.3 * wave) * np.float32((1.0, 0.8, 0.6))


def floor_from(x: float, hidden: float = -9.0) -> Frame:
    """A textured floor seen from above `x`; left of `hidden` a red shelf one unit above it."""
    view = floor_view()[0]
    camera = view.camera_to_world.copy()
    camera[0, 3] = x
    view = replace(view, camera_to_world=camera)
    origin, rays = view_rays(view)
    floor, shelf = (origin - rays * ((origin[2] - z) / rays[..., 2:]) for z in (0.0, 1.0))
    on_shelf = shelf[..., :1] < hidden
    position = np.where(on_shelf, shelf, floor) + np.float32((5, 0, 0))  # nothing is at the origin
    radiance = np.where(on_shelf, np.float32((0.9, 0.1, 0.1)), waves(position))
    camera = camera.copy()
    camera[0, 3] += 5
    return Frame(replace(view, camera_to_world=camera), radiance, position)


def test_the_same_frame_twice_does_not_flicker():
    assert measure_flicker(floor_from(0), floor_from(0)) == pytest.approx((0, 0, 1), abs=1e-6)


def test_noise_flickers_as_much_as_it_changes():
    frame, noise = floor_from(0), np.random.default_rng(0).random((2, 64, 64, 3)).astype(np.float32) ** 2.4
    change = measure_flicker(*(frame._replace(radiance=radiance) for radiance in noise))
    assert change.mean > 0.2 and change.median > 0.2 and change.compared == 1
    dimmer = measure_flicker(*(frame._replace(radiance=frame.radiance + 0.05 * radiance) for radiance in noise))
    assert 0.005 < dimmer.mean < 0.1 * change.mean + 0.02


def test_a_texture_that_moves_with_its_surface_does_not_flicker():
    before, after = floor_from(0), floor_from(STEP)
    where_it_was = np.abs(after.radiance - before.radiance).mean()
    change = measure_flicker(before, after)
    assert change.mean < 0.001 < 0.02 * where_it_was and change.compared > 0.9


def test_light_that_changes_on_a_moving_surface_flickers():
    after = floor_from(STEP)
    change = measure_flicker(floor_from(0), after._replace(radiance=after.radiance * 1.1))
    assert 0.02 < change.median < 0.05


def test_what_is_hidden_in_one_of_the_frames_is_not_compared():
    before, after = floor_from(0, hidden=-0.2), floor_from(-STEP * 3, hidden=-0.2)
    change = measure_flicker(before, after)
    assert change.compared < measure_flicker(floor_from(0), floor_from(-STEP * 3)).compared - 0.02
    assert change.mean < 0.01  # the shelf's edge alone


def test_frames_that_see_nothing_in_common_are_refused():
    with pytest.raises(ValueError, match="nothing in common"):
        measure_flicker(floor_from(0), floor_from(50))


def test_points_on_the_rays_of_a_view_are_seen_at_their_pixels():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    pose = np.eye(4, dtype=np.float32)
    pose[:3, :3], pose[:3, 3] = turn * np.linalg.det(turn), (1, 2, 3)
    view = View(pose, np.float32((50, 40)), np.float32((10, 14)), 24, 16)
    origin, rays = view_rays(view)
    columns, rows, depth = project_to_pixels(view, origin + 3 * rays)
    assert columns == pytest.approx(np.tile(np.arange(24), (16, 1)), abs=1e-3)
    assert rows == pytest.approx(np.tile(np.arange(16)[:, None], (1, 24)), abs=1e-3)
    assert (depth > 0).all() and (project_to_pixels(view, origin - rays)[2] < 0).all()


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    import bpy
    ring.build(ring.LEAST, 32)
    path = tmp_path_factory.mktemp("room") / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def run(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "tools.flicker", *map(str, arguments)], cwd=ROOT, text=True,
                          capture_output=True, timeout=600)


def rendered(done: subprocess.CompletedProcess) -> list[Path]:
    """The frames whose seconds were printed."""
    lines = [re.fullmatch(r"(.*): (\d+\.\d) s", line).groups() for line in done.stderr.splitlines()]
    assert all(float(seconds) > 0 for _, seconds in lines)
    return [Path(file) for file, _ in lines]


@pytest.mark.slow
def test_an_orbit_is_rendered_once_by_both_engines_and_compared(room, tmp_path):
    arguments = room, "-o", tmp_path, "--frames", 3, "--degrees", 4, "--samples", 2, 1, "--resolution", "32x24"
    first = run(*arguments)
    assert first.returncode == 0, first.stderr
    found, files = json.loads(first.stdout), sorted(tmp_path.rglob("*.exr"))
    in_turn = [sorted(Path(found[engine]["folder"]).glob("*.exr")) for engine in ("renderformer", "cycles", "cycles_1")]
    assert len(files) == 9 and rendered(first) == sum(in_turn, [])
    for engine in ("renderformer", "cycles", "cycles_1"):
        assert 0 < found[engine]["flicker"] < 0.5 and len(found[engine]["pairs"]) == 2
        assert 0.5 < found[engine]["compared"] <= 1
        of_engine = sorted(Path(found[engine]["folder"]).glob("*.exr"))
        positions = [read_pass(file, "Position", "XYZ") for file in of_engine]
        assert positions[0].shape == (24, 32, 3) and not np.allclose(positions[0], positions[1], atol=1e-3)
    least = found["cycles"]["flicker"]
    assert found["ratio"] == pytest.approx({name: found[name]["flicker"] / least for name in (
        "renderformer", "cycles_1")}, rel=0.01)

    files[0].unlink()
    again = run(*arguments, "--film", tmp_path / "film.webp")
    assert again.returncode == 0 and rendered(again) == files[:1]
    assert json.loads(again.stdout) == found
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.n_frames, film.size) == (3, (3 * 32, 24))


def test_a_camera_that_stands_still_gives_no_flicker(room, tmp_path):
    done = run(room, "-o", tmp_path, "--frames", 2, "--degrees", 0, "--samples", 1, "--resolution", "32x24")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert max(found["renderformer"]["flicker"], found["cycles"]["flicker"]) < 1e-4


def test_a_scene_that_is_not_there_is_named(tmp_path):
    done = run(tmp_path / "none.blend", "-o", tmp_path / "out")
    assert done.returncode == 1 and done.stderr == f"{tmp_path / 'none.blend'}: there is no such file\n"
    assert not (tmp_path / "out").exists()
