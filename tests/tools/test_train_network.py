# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.train.network` says what is wrong with its data, and goes on after a kill."""
import json
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from tests.model.samples import floor_scene, floor_view
from tests.tools.lpips_weights import write_weights
from tools.common import lpips
from tools.datagen import manifest
from tools.datagen.sample_files import save_sample
from tools.evaluate import __main__ as evaluate
from tools.train import losses, network, prepare
from tools.train.config import Stage
from tools.train.errors import TrainingError
from tools.train.loader import Prepared, SampleStream, light_inputs_of, stream
from tools.train.samples import LOBES, LightInputs

ROOT = Path(__file__).parents[2]
ANY = Stage(1)
STILL = replace(ANY, scene=0.0)  # the same is given of a sample every time


def write(folder: Path, seed: int, size: int = 64) -> None:
    view, guides = floor_view(size, size)
    light = np.full((size, size, 3), 0.1 * seed, np.float32)
    reference = {f"{lobe}_{part}": light for lobe in LOBES for part in ("direct", "indirect")}
    reference["combined"] = np.concatenate([guides.diffuse_color * light, guides.alpha[..., None]], -1)
    folder.mkdir(exist_ok=True)
    save_sample(folder / f"scene_{seed:08d}.npz", replace(floor_scene()), [view], [guides], [reference])


def mapper(parameters: torch.Tensor) -> torch.Tensor:
    return torch.zeros(*parameters.shape[:-1], 9)


def order(folder: Path, seed: tuple[int, int]) -> list[float]:
    """What the first two epochs show, by the brightness of the pictures."""
    (folder / "cache").mkdir(exist_ok=True)
    samples = iter(SampleStream(folder, Prepared(folder / "cache", mapper, STILL), ANY, seed, 0.0))
    return [round(float(next(samples).direct.mean()), 3) for _ in range(12)]


def test_every_start_has_an_order_of_its_own_and_always_the_same(tmp_path):
    for seed in range(1, 7):
        write(tmp_path / "data", seed)
    orders = [order(tmp_path / "data", seed) for seed in ((0, 0), (0, 1), (1, 0), (0, 0))]
    assert orders[0] == orders[3] and len({tuple(o) for o in orders}) == 3
    assert len(set(orders[0][:6])) == len(set(orders[0][6:])) == 6


@pytest.mark.parametrize("augmented", [True, False])
def test_samples_are_turned_only_where_the_stage_says_so(tmp_path, augmented):
    write(tmp_path, 1)
    read = Prepared(tmp_path / "cache", None, replace(STILL, augmented=augmented))
    (tmp_path / "cache").mkdir()
    corners = [read(next(tmp_path.glob("*.npz")), torch.Generator().manual_seed(seed)).inputs.triangles
               for seed in range(4)]
    assert all(torch.equal(corners[0], other) for other in corners[1:]) is not augmented


@pytest.mark.slow
def test_streams_with_any_number_of_workers_yield_together_what_one_would(tmp_path):
    for seed in range(1, 6):
        write(tmp_path / "data", seed)
    (tmp_path / "cache").mkdir()

    def shown(place: int, count: int, workers: int, number: int) -> list[float]:
        read = Prepared(tmp_path / "cache", mapper, STILL)
        samples = SampleStream(tmp_path / "data", read, ANY, (0, 0), 0.0, place, count)
        loaded = iter(DataLoader(samples, batch_size=None, num_workers=workers))
        return [float(next(loaded).direct.mean()) for _ in range(number)]

    whole = shown(0, 1, 0, 12)
    assert shown(0, 1, 2, 12) == whole
    assert [shown(place, 2, 2, 6) for place in (0, 1)] == [whole[0::2], whole[1::2]]


@pytest.mark.parametrize("count, stage, message", [
    (None, ANY, "there is no folder .*data: check --data"),
    (0, ANY, "data holds no samples .*make some with python -m tools.datagen"),
    (2, Stage(1, max_triangles=1), "none of the 2 samples of .*max_triangles=1.*make more of them"),
])
def test_data_that_gives_nothing_is_an_error_and_no_endless_wait(tmp_path, count, stage, message):
    for seed in range(1, (count or 0) + 1):
        write(tmp_path / "data", seed)
    if count == 0:
        (tmp_path / "data").mkdir()
    with pytest.raises(TrainingError, match=message):
        next(stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, stage), stage, (0, 0), 0.0))


def test_what_the_manifest_says_of_a_sample_spares_reading_it(tmp_path):
    for seed in (1, 2):
        write(tmp_path / "data", seed)
    lines = [manifest.make_entry(path) for path in sorted((tmp_path / "data").glob("scene_*.npz"))]
    lines[0]["volumes"] = True  # which is not so
    manifest.append_entries(tmp_path / "data" / "manifest_00000001.jsonl", lines)
    stage = replace(STILL, volumes=False)
    samples = stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, stage), stage, (0, 0), 0.0)
    plain = iter(SampleStream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, STILL), ANY, (0, 0), 0.0))
    assert {float(next(samples).direct.mean()) for _ in range(4)} == {
        max(float(next(plain).direct.mean()) for _ in range(2))}


def test_a_broken_file_is_named_once_and_left_out(tmp_path, capfd):
    for seed in (1, 3):
        write(tmp_path / "data", seed)
    (tmp_path / "data" / "scene_00000002.npz").write_text("junk")
    samples = stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, ANY), ANY, (0, 0), 0.0)
    assert len({round(float(next(samples).direct.mean()), 3) for _ in range(8)}) == 2
    said = capfd.readouterr().out
    assert said.count("scene_00000002.npz cannot be read") == said.count("\n") == 1


def test_pictures_of_a_size_that_the_network_cannot_draw_are_left_out_with_a_remedy(tmp_path, capfd):
    write(tmp_path / "data", 1)
    write(tmp_path / "data", 2, size=96)
    samples = stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, ANY), ANY, (0, 0), 0.0)
    assert len({round(float(next(samples).direct.mean()), 3) for _ in range(4)}) == 1
    assert "96 x 96 pixels, but the network trains on multiples of 64: make others with" in capfd.readouterr().out


def test_nothing_but_broken_files_ends_the_run(tmp_path):
    (tmp_path / "data").mkdir()
    for content in ("", "junk"):
        (tmp_path / "data" / f"scene_0000000{len(content)}.npz").write_text(content)
    with pytest.raises(TrainingError, match="none of the 2 samples of .*data can be read"):
        next(stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, ANY), ANY, (0, 0), 0.0))


@pytest.mark.parametrize("program, arguments", [
    (network, ["--data", "data", "--out", "run", "--minutes", "1"]), (evaluate, ["data", "-o", "report"])])
def test_a_negative_number_of_threads_is_refused(monkeypatch, capsys, program, arguments):
    monkeypatch.setattr(sys, "argv", ["program", *arguments, "--threads", "-1"])
    with pytest.raises(SystemExit, match="2"):
        program.main()
    assert "--threads: -1: expected a whole number from 0" in capsys.readouterr().err


def test_prepared_samples_are_what_training_reads(tmp_path, monkeypatch, capsys):
    for seed in range(1, 4):
        write(tmp_path / "data", seed)
    (tmp_path / "data" / "scene_00000009.npz").write_bytes(b"PK")
    monkeypatch.setattr("sys.argv", ["prepare", "--data", str(tmp_path / "data"), "--processes", "1"])
    assert prepare.main() == 0
    assert "4 samples are prepared" in capsys.readouterr().out
    stored = {file: file.stat().st_mtime_ns for file in (tmp_path / "cache").iterdir()}
    assert len(stored) == 6  # of each sample that can be read, as it is given and by its scene alone
    samples = iter(SampleStream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, ANY), ANY, (0, 0), 0.0))
    for _ in range(9):
        next(samples)
    assert stored == {file: file.stat().st_mtime_ns for file in (tmp_path / "cache").iterdir()}


def test_a_quarter_of_all_scenes_is_given_without_traced_light_and_always_the_same():
    inputs = [light_inputs_of(Path(f"scene_{seed:08d}.npz"), 0.25) for seed in range(400)]
    assert 70 < inputs.count(LightInputs.RAYS) < 130 and set(inputs) == {LightInputs.RAYS, LightInputs.TRACED}
    assert inputs == [light_inputs_of(Path(f"elsewhere/scene_{seed:08d}.npz"), 0.25) for seed in range(400)]


def test_a_folder_that_is_just_being_filled_is_waited_for(tmp_path):
    (tmp_path / "data").mkdir()
    threading.Timer(0.5, write, (tmp_path / "data", 1)).start()
    samples = stream(tmp_path / "data", Prepared(tmp_path / "cache", mapper, ANY), ANY, (0, 0), 60.0)
    assert next(samples).image.shape == (1, 3, 64, 64)


@pytest.mark.parametrize("backbone", lpips.BACKBONES)
def test_the_perceptual_network_is_on_the_device_of_the_pictures(tmp_path, monkeypatch, backbone):
    (tmp_path / "checkpoints").mkdir()
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    write_weights(tmp_path / "checkpoints", backbone)
    device = torch.device("meta")
    picture = torch.zeros(1, 3, 64, 64, device=device)
    assert losses.perceptual_term(device, backbone)(picture, picture).device == device
    other, = lpips.BACKBONES.keys() - {backbone}
    assert losses.perceptual_term(device, other) is losses.structure_loss


def command(folder: Path, minutes: float) -> list[str]:
    return [sys.executable, "-m", "tools.train.network", "--data", str(folder / "data"), "--out", str(folder / "run"),
            "--minutes", str(minutes), "--save-every", "0", "--wait", "0", "--device", "cpu"]


def test_a_mistyped_folder_is_one_sentence(tmp_path):
    done = subprocess.run(command(tmp_path, 1), cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 2 and "there is no folder" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_killed_run_is_resumed_where_it_was(tmp_path):
    for seed in (1, 2):
        write(tmp_path / "data", seed)
    state, text = tmp_path / "run" / "state.safetensors", tmp_path / "run" / "log.jsonl"
    running = subprocess.Popen(command(tmp_path, 5), cwd=ROOT, stdout=subprocess.DEVNULL)
    begin = time.monotonic()
    while not (tmp_path / "run" / "state.previous.safetensors").is_file():
        assert running.poll() is None and time.monotonic() - begin < 600
        time.sleep(0.1)
    running.kill()
    running.wait()
    text.write_text('{"step": 1}\n{"st')
    done = subprocess.run(command(tmp_path, 0.05), cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    reached = int(done.stdout.split(" parameters, step ")[1].split()[0])
    assert reached >= 1 and state.is_file() and (tmp_path / "run" / "weights" / "model.safetensors").is_file()
    assert json.loads(text.read_text().splitlines()[0]) == {"step": 1} and '\n{"st\n' in text.read_text()
