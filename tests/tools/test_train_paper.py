# SPDX-License-Identifier: GPL-3.0-or-later
"""The authors' eight stages as configurations, each run for some steps with a network in miniature; and the cost of the
paper's five."""
import argparse
import json
from dataclasses import replace
from pathlib import Path

import pytest
from safetensors.torch import load_file

from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.published.bundle import load_transformer
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.tools.test_finetune import options
from tests.tools.test_train_ranks import write
from tools.datagen.sample_files import read_facts
from tools.train import cost, published, throughput
from tools.train.config import TrainConfig, iterate_stages
from tools.train.errors import TrainingError
from tools.train.state import TrainingState

PAPER = Path(published.__file__).with_name("paper")
WEIGHTS = Path("transformer_512") / "model.safetensors"
STAGES = [f"stage{number}" for number in range(1, 9)]
CARDS = 32


def config(name: str) -> TrainConfig:
    return TrainConfig.load(PAPER / f"{name}.json")


def test_all_stages_train_one_after_the_other_from_new_weights(tmp_path):
    for seed in range(1, 5):
        write(tmp_path / "data", seed)
    start = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    for stage in STAGES:
        out = tmp_path / stage
        chosen = options(tmp_path, start, out=out, minutes=None, steps=2, scenes_per_step=2, cache=tmp_path / "cache",
                         from_scratch=stage == "stage1")
        published.train(chosen, config(stage))
        lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
        assert lines[-1]["step"] == 2 and lines[-1]["skipped"] == 0
        before, after = load_file(start / WEIGHTS), load_file(out / "bundle" / WEIGHTS)
        goes_on = all((before[name] - after[name]).abs().max() < 1e-3 for name in before)
        assert goes_on == (stage != "stage1"), "the first one has new weights, not those of the bundle"
        start = out / "bundle"
    assert not (start / "transformer_2048").exists()


@pytest.mark.parametrize("settings", [
    {"dense": True}, {"light_sinks": False}, {"summaries": False}, {"summary_block_size": 7},
    {"local_attention_window_size_half": 3}])
def test_a_row_of_the_papers_table_is_trained_and_rendered_with_its_setting(tmp_path, settings):
    write(tmp_path / "data", 1)
    start = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    for from_scratch in (True, False):
        out = tmp_path / f"{from_scratch}"
        chosen = options(tmp_path, start, out=out, minutes=None, steps=1, scenes_per_step=1, cache=tmp_path / "cache",
                         from_scratch=from_scratch)
        published.train(chosen, replace(config("stage3"), network=settings, copies=1))
        trained = load_transformer(out / "bundle" / "transformer_512")
        assert {name: getattr(trained.config, name) for name in settings} == settings
    published.train(options(tmp_path, out / "bundle", out=tmp_path / "next", minutes=None, steps=1, scenes_per_step=1,
                            cache=tmp_path / "cache"), replace(config("stage3"), copies=1))
    assert load_transformer(tmp_path / "next" / "bundle" / "transformer_512").config == trained.config


@pytest.mark.parametrize("settings, message", [({"colour": 1}, "unknown keys in model_config: colour"),
                                               ({"dim_feedforward": 32}, "do not fit .* --from-scratch")])
def test_a_setting_that_the_network_cannot_have_is_said(tmp_path, settings, message):
    write(tmp_path / "data", 1)
    start = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    with pytest.raises(TrainingError, match=message):
        published.train(options(tmp_path, start, minutes=None, steps=1), replace(config("stage3"), network=settings))


def test_the_first_stages_add_textures_and_then_environments_and_volumes(tmp_path):
    for seed in range(1, 4):
        write(tmp_path / "data", seed)
    plain, sky, smoke = (read_facts(path) for path in sorted((tmp_path / "data").glob("scene_*.npz")))
    textured = replace(plain, textures=True)
    kinds = {"plain": plain, "textured": textured, "sky": sky, "smoke": smoke}
    admitted = [[name for name, scene in kinds.items() if config(stage).stages[0].admits(scene)] for stage in STAGES]
    assert admitted == [["plain"], ["plain", "textured"], *[["plain", "textured", "sky", "smoke"]] * 6]
    assert not config("stage1").stages[0].admits(replace(plain, triangles=1025))


@pytest.mark.parametrize("name, triangles, batch, rate, parts", [
    ("stage1", 1024, 4, 1e-4, 0), ("stage2", 1024, 8, 1e-4, 0), ("stage3", 1024, 16, 1e-4, 0),
    ("stage4", 4096, 8, 7.5e-5, 1), ("stage5", 16384, 8, 1e-4, 2), ("stage6", 16384, 8, 5e-5, 2),
    ("stage7", 65536, 8, 1.25e-5, 2), ("stage8", 65536, 8, 1.25e-5, 2)])
def test_configurations_are_the_authors(name, triangles, batch, rate, parts):
    chosen = config(name)
    assert (chosen.scenes_per_step, chosen.learning_rate, chosen.weight_decay) == (CARDS * batch, rate, 0.01)
    assert (chosen.warmup_steps, chosen.cosine_steps) == (1000, 298_000) and chosen.rate(999) == rate
    assert chosen.rate(300_000) == pytest.approx(0.01 * rate)
    assert list(chosen.recomputed) == ["transformer.", "view_transformer."][:parts]
    stage, = chosen.stages
    assert (stage.steps, stage.max_triangles, stage.views) == (300_000, triangles, 2)
    assert stage.crop == (512 if name == "stage8" else None)


def test_a_stage_may_see_all_tokens():
    stages = replace(config("stage1").stages[0], steps=1, dense=True), config("stage1").stages[0]
    network = new_network(tiny_published_config())
    state = TrainingState(network, 1e-4, 0.0, 0.9)
    samples = iterate_stages(replace(config("stage1"), stages=stages), state, lambda stage: iter([stage] * 2))
    for state.step, stage in enumerate(stages):
        assert next(samples) == stage and (network.transformer.half is None) == stage.dense


def test_costs_follow_the_formula():
    found = {row["stage"]: row for row in cost.rows((8, 32), 1e14)}
    assert sum(stage.days for stage in cost.STAGES) == 19 == sum(row["days"][32] for row in found.values())
    assert found["stage2"]["tflop_per_scene"] > found["stage3"]["tflop_per_scene"]
    assert all(row["days"][8] == pytest.approx(4 * row["days"][32]) for row in found.values())
    tiny = argparse.Namespace(device="cpu", precision="fp32", dense=True, compile=False, steps=1, triangles=258,
                              resolution=64)
    measured = throughput.measure(tiny_published_config(), tiny)
    assert measured["tokens_per_second"] > 0 and measured["triangles"] == 258
    assert measured["tflop"] == pytest.approx(
        cost.training_flops(tiny_published_config(), 258, 64, dense=True) / 1e12, abs=1e-3)
