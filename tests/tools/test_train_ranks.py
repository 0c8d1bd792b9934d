# SPDX-License-Identifier: GPL-3.0-or-later
"""Training by several processes, as torchrun starts them, is the training of one; with gloo on this processor."""
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderformer_v2.model.scene import Volumes
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.model.samples import floor_scene, floor_view
from tools.datagen.sample_files import save_sample
from tools.train.samples import LOBES

ROOT = Path(__file__).parents[2]
MINIATURE = {"latent_dim": 48, "num_layers": 2, "num_heads": 2, "dim_feedforward": 64, "vertex_pe_num_freqs": 3,
             "intra_rope_pe_num_freqs": 8, "envmap_ray_dir_map_patch_size": 4, "view_transformer_latent_dim": 48,
             "view_transformer_ffn_hidden_dim": 64, "view_transformer_n_heads": 2, "dpt_features": 8,
             "dpt_out_channels": [6, 8, 10, 12]}


def write(folder: Path, seed: int) -> None:
    """A scene of its own for each seed; the second one has a sky, the third one smoke, as the others have not."""
    rng = np.random.default_rng(seed)
    scene, (view, guides) = floor_scene(), floor_view()
    if seed == 2:
        scene = replace(scene, environment=rng.random((256, 512, 3), np.float32))
    if seed == 3:
        scene = replace(scene, volumes=Volumes(
            density=np.ones((2, 64), np.float32), position=np.float32([[0, 0, 0.5], [0.2, 0, 0.5]]),
            rotation=np.zeros((2, 3), np.float32), scale=np.full((2, 3), 0.2, np.float32),
            scattering=np.ones((2, 3), np.float32), absorption=np.ones((2, 3), np.float32)))
    light = rng.random((64, 64, 3), np.float32)
    reference = {f"{lobe}_{part}": light for lobe in LOBES for part in ("direct", "indirect")}
    reference["combined"] = np.concatenate([guides.diffuse_color * light, guides.alpha[..., None]], -1)
    folder.mkdir(exist_ok=True)
    save_sample(folder / f"scene_{seed:08d}.npz", scene, [view], [guides], [reference])


def launch(processes: int, module: str, *arguments) -> subprocess.CompletedProcess:
    """`python -m module`, by torchrun if there is to be more than one process."""
    launcher = ["torch.distributed.run", "--standalone", f"--nproc-per-node={processes}", "-m", "--"]
    words = [*(launcher if processes > 1 else []), module, *map(str, arguments)]
    return subprocess.run([sys.executable, "-m", *words], cwd=ROOT, capture_output=True, text=True, timeout=600)


def train(folder: Path, out: str, processes: int, steps: int, module: str = "network", *more) -> list[dict]:
    """The diary after training in folder/out to so many steps, two scenes each."""
    done = launch(processes, f"tools.train.{module}", "--data", folder / "data", "--out", folder / out,
                  "--steps", steps, "--scenes-per-step", 2, "--log-every", 1, "--precision", "fp32", "--threads", 1,
                  *more)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in (folder / out / "log.jsonl").read_text().splitlines()]


def same(a: list[dict], b: list[dict], tolerance: float = 1e-5) -> None:
    assert [line["step"] for line in a] == [line["step"] for line in b]
    for one, other in zip(a, b):
        for name in set(one) - {"step", "minutes", "skipped"}:
            assert one[name] == pytest.approx(other[name], abs=tolerance), (one, other)


@pytest.mark.slow
def test_two_processes_with_half_of_each_step_lose_what_one_does_and_go_on_as_another_number(tmp_path):
    for seed in range(1, 6):
        write(tmp_path / "data", seed)
    chosen = json.loads((ROOT / "tools" / "train" / "rf2_small.json").read_text()) | {"network": MINIATURE}
    (tmp_path / "config.json").write_text(json.dumps(chosen))

    def run(out: str, processes: int, steps: int) -> list[dict]:
        return train(tmp_path, out, processes, steps, "network", "--config", tmp_path / "config.json")

    one, two = run("one", 1, 20), run("two", 2, 20)
    assert len({line["total"] for line in one}) == len(one) == 20
    same(one, two)
    same(run("two", 1, 23)[20:], run("one", 2, 23)[20:])


@pytest.mark.slow
def test_a_published_network_is_tuned_by_two_as_by_one(tmp_path):
    for seed in (1, 2, 4):
        write(tmp_path / "data", seed)
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    one, two = (train(tmp_path, f"by-{n}", n, 20, "published", "--start", bundle) for n in (1, 2))
    same(one, two)
    for n in (1, 2):
        assert (tmp_path / f"by-{n}" / "bundle" / "transformer_512" / "model.safetensors").is_file()


@pytest.mark.slow
def test_small_parts_are_trained_by_two_as_by_one(tmp_path):
    for n in (1, 2):
        done = launch(n, "tests.tools.rank_program", tmp_path)
        assert done.returncode == 0, done.stderr
    found = (tmp_path / f"{name}.json" for name in ("0-of-1", "0-of-2", "1-of-2"))
    alone, first, second = (json.loads(file.read_text()) for file in found)
    assert alone["spheres"] == pytest.approx(first["spheres"], abs=1e-5) and first["spheres"] == second["spheres"]
    assert alone["share"] == "3" and "--scenes-per-step: 3 cannot be shared equally by 2" in second["share"]
    assert (second["agreed"], second["means"], second["gathered"]) == (5.0, 0.5, [0, 1])


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="PyTorch needs a C++ compiler")
def test_compiled_parts_train_as_others_do():
    program = [sys.executable, "-m", "tests.tools.compiled_program"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
