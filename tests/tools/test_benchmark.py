# SPDX-License-Identifier: GPL-3.0-or-later
"""Costs by formula, the extrapolation of Cycles, the scene, and a benchmark that goes on where it was."""
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.weights.presets import rf2_200m
from tests.model.published.bundles import tiny_published_config, tiny_vae
from tools.benchmark import device, farm, load, textures
from tools.benchmark.flops import decoder_flops_per_ray, forward_flops, product_rate, stage1_flops, visible_pairs
from tools.benchmark.report import compute_stage1_ratio, extrapolate_cycles
from tools.benchmark.ring import LEAST, triangle_corners

ROOT = Path(__file__).parents[2]


def test_flops_of_the_published_network_are_those_of_the_specification():
    assert decoder_flops_per_ray(rf2_200m()) == 51_605_504
    flops = forward_flops(rf2_200m(), 4096, 0, 512)
    tera = {name: round(value / 1e12, 2) for name, value in flops.items()}
    assert round(stage1_flops(flops) / 1e12, 1) == 1.1
    assert (tera["keys_values"], tera["cross_attention"], tera["decoder"]) == (0.06, 0.32, 0.21)
    assert round((flops["stage2_linear"] + flops["swin_attention"]) / 1e12, 2) == 0.53
    large = forward_flops(rf2_200m(), 65536, 0, 2048)
    for name, expected in (("stage1_linear", 15), ("stage1_attention", 6.6), ("cross_attention", 80), ("decoder", 3.4)):
        assert large[name] / 1e12 == pytest.approx(expected, rel=0.01)


def test_stage_one_costs_two_and_a_half_times_as_much_for_twice_the_triangles():
    small, large = (stage1_flops(forward_flops(rf2_200m(), n, 2, 512)) for n in (65536, 131072))
    assert large / small == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize("sink, ordered, half", [(3, 9, 2), (0, 4, 5), (2, 5, 5)])
def test_visible_pairs_are_those_of_the_mask(sink, ordered, half):
    index = np.arange(sink + ordered)
    mask = abs(index[:, None] - index) <= half
    mask[:sink], mask[:, :sink] = True, True
    assert visible_pairs(sink, ordered, half) == mask.sum()


def test_cycles_is_extrapolated_without_its_fixed_cost_being_multiplied():
    assert extrapolate_cycles({16: 5 + 16 * 0.25, 4: 5 + 4 * 0.25}) == pytest.approx(5 + 4096 * 0.25)
    rows = [{"subject": "rf2_200m", "triangles": n, "stage1_seconds": s, "stage1_flops": s} for n, s in
            ((65536, 2.0), (131072, 5.0))]
    assert compute_stage1_ratio(rows)["stage1_seconds"] == 2.5 and compute_stage1_ratio(rows[:1]) is None


@pytest.mark.parametrize("asked", [LEAST, 1638, 4097, 65536])
def test_the_scene_has_nearly_as_many_triangles_as_asked_for(asked):
    corners, lamp = triangle_corners(asked)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert 0.995 * asked <= len(corners) <= asked and lamp.sum() == 2 and area.min() > 0
    facing = np.cross(corners[lamp][:, 1] - corners[lamp][:, 0], corners[lamp][:, 2] - corners[lamp][:, 0])
    assert (facing[:, 2] < 0).all()


@pytest.mark.slow
def test_a_point_is_measured_once_and_both_outputs_are_written(tmp_path):
    command = [sys.executable, "-m", "tools.benchmark", "-o", str(tmp_path), "--quick", "--cycles-samples", "0",
               "--presets", "rf2_small", "--precision", "fp32", "--threads", "1"]
    outputs = [subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600) for _ in range(2)]
    assert all(done.returncode == 0 for done in outputs), outputs
    first, second = (json.loads(done.stdout) for done in outputs)
    assert first == second and outputs[0].stderr and not outputs[1].stderr
    (network,) = first["networks"]
    assert network["flops"] > 1e9 and network["seconds"] > 0 and 0 < network["efficiency"]
    assert (tmp_path / "benchmark.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "benchmark.csv").read_text().splitlines()) == 2


@pytest.mark.slow
def test_conversion_is_measured_for_every_budget(tmp_path):
    import bpy
    bpy.ops.wm.read_factory_settings()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cube.blend"), copy=True)
    command = [sys.executable, "-m", "tools.benchmark.conversion", str(tmp_path / "cube.blend"),
               "--budgets", "300,1024", "--resolutions", "64"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    (few, many), = json.loads(done.stdout).values()
    assert few["triangles"] == 12 < few["remaining"] <= 300 == few["budget"] < many["remaining"]
    assert 0 < many["longest_wait"] <= many["seconds"] and many["share_of_published"]["64"] > 0


def test_fewer_triangles_than_the_benchmark_has_are_refused():
    command = [sys.executable, "-m", "tools.benchmark.conversion", "--budgets", "64"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and done.stdout == "" and "at least" in done.stderr.splitlines()[-1]


def test_renders_beside_busy_programs_are_compared_with_those_beside_the_fewest():
    measured = {0: [{"Network": 1.0, "total": 2.0}, {"Network": 3.0, "total": 9.0}, {"Network": 2.0, "total": 4.0}],
                2: [{"Network": 4.0, "total": 4.0}]}
    found = load.summarize(measured)
    assert found["seconds"] == {0: {"Network": 2.0, "total": 4.0}, 2: {"Network": 4.0, "total": 4.0}}
    assert found["times"][2] == {"Network": 2.0, "total": 1.0}


def test_busy_programs_end_with_what_they_disturb():
    children = ["ps", "--ppid", str(os.getpid()), "-o", "args"]
    with load.busy_programs(2):
        assert subprocess.run(children, capture_output=True, text=True).stdout.count("while 1: pass") == 2
    assert "while 1: pass" not in subprocess.run(children, capture_output=True, text=True).stdout


def test_costs_of_frames_follow_from_start_first_and_later_ones():
    row = farm.FrameCosts(2, 1, 4.0, 10.0, 6.0, 900.0, 20.0, 9.0)
    assert row.task_seconds(5) == 38.0 and row.machine_seconds(5) == 3.8
    assert row.machine_seconds(1) > row.machine_seconds(100)
    assert row.job_hours(10000, 100, 10) == pytest.approx(5 * 68 / 3600)  # 1,000 tasks for 200 processes
    assert row.job_hours(10000, 100, 100) == pytest.approx(608 / 3600)


@pytest.mark.slow
def test_processes_side_by_side_are_measured(tmp_path):
    done = subprocess.run([sys.executable, "-m", "tools.benchmark.farm", "--processes", "1,2", "--frames", "2",
                           "--triangles", "512", "--resolution", "32"], cwd=ROOT, capture_output=True, text=True,
                          timeout=900)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [row["processes"] for row in found["measured"]] == [1, 2]
    assert all(row["later"] > 0 and row["first"] > 0 and row["memory_mib"] > 100 and row["core_seconds"] > 0.1
               for row in found["measured"])
    assert found["job"]["frames"] == 10000 and set(found["machine_seconds_per_frame"]) == {"1", "2"}


def test_a_device_is_measured_by_itself(monkeypatch):
    monkeypatch.setattr(device, "product_rate", lambda *given: product_rate(*given, size=64))
    found = device.measure("cpu", "bf16", LEAST, 64, tiny_published_config())
    assert found["precision"] == "BFloat16" and found["precision_fails"] == "" and found["finite"]
    assert 0 < found["rms_error"] < 0.1 and found["stage2_seconds"] > 0 and found["device"].startswith("CPU")
    assert json.loads(json.dumps(found)) == found


def test_encoding_textures_is_measured_at_the_first_render_and_at_a_later_one(monkeypatch):
    monkeypatch.setitem(textures.SIZES, "hidden_dim", 8)
    monkeypatch.setattr(textures, "product_rate", lambda *given, **clock: product_rate(*given, size=64, **clock))
    found = textures.measure(3, torch.device("cpu"), tiny_vae())
    assert found["video_seconds"] > 0 and found["image_seconds"] > 0 and found["triangles"] == 3
    assert found["first_seconds"] > 0 and found["later_seconds"] >= 0 and found["times"] > 0
    assert found["product_share"] > 0 and 0 < found["multiplications_3x3"] < found["multiplications"]
    scene = textures.make_textured_scene(3)
    assert len(np.unique(scene.tiles[:, 0], axis=0)) == 3 and np.ptp(scene.tiles[0, 0].astype(float)) > 0.01


@inference()
def test_the_image_encoders_multiplications_are_those_of_its_layers():
    with torch.device("meta"):
        frame = textures.OneFrameEncoder(textures.vae_class()())
        found = textures.count_multiplications(frame, torch.empty(1, 3, 32, 32))
    levels = (1024, 96, 96), (256, 96, 192), (64, 192, 384), (16, 384, 384)  # places, channels before and after
    ends = 9 * (1024 * 3 * 96 + 16 * 384 * 32)
    square = sum(9 * places * (before + 3 * after) * after for places, before, after in levels)
    square += 9 * 16 * 4 * 384 ** 2 + ends  # the middle
    strided = sum(9 * places // 4 * after ** 2 for places, _, after in levels[:3])
    point = 256 * 96 * 192 + 64 * 192 * 384 + 16 * (4 * 384 ** 2 + 32 ** 2)  # shortcuts, attention, the last one
    attention = 2 * 16 ** 2 * 384
    assert found == {"multiplications": square + strided + point + attention, "multiplications_3x3": square}


def test_a_device_that_is_not_there_is_said():
    command = [sys.executable, "-m", "tools.benchmark", "--device", "cuda:7"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "Automatic or CPU" in done.stderr
