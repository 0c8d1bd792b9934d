# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.network --data DIR --out DIR --minutes M: train the bundled network on tools.datagen samples.

Resumes from DIR/state.safetensors and may run for days: the learning rate stays constant after the warm-up and falls to
zero during the last --cooldown minutes. DIR/weights holds the running average, ready for `--weights DIR/weights`.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import torch

from renderformer_v2.model.checkpoint import load_material_mapper, save_small
from renderformer_v2.model.guided.guidance import decode_light, encode_guided, view_guided
from renderformer_v2.model.network.config import PRESETS
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.threads import team

from .config import TrainConfig
from .loader import stream
from .losses import image_loss, lobe_loss, perceptual_term
from .samples import TrainingSample
from .state import TrainingState

LOG_EVERY, SAVE_SECONDS = 50, 180


def sample_loss(model: RenderFormer, sample: TrainingSample, perceptual) -> dict[str, torch.Tensor]:
    """Losses of all views of one scene."""
    context = encode_guided(model, sample.inputs, sample.beam_axis, sample.beam_cosine)
    raw = view_guided(model, context, sample.rays_o, sample.rays_d, sample.guides)
    light = decode_light(raw, sample.guides)
    colors = sample.guides.colors
    losses = {"image": image_loss(light["image"], sample.image, perceptual),
              "direct": lobe_loss(light["direct"], sample.direct, colors),
              "indirect": lobe_loss(light["indirect"], sample.indirect, colors)}
    return losses | {"total": sum(losses.values())}


def train(options: argparse.Namespace, config: TrainConfig) -> None:
    device = torch.device(options.device)
    torch.manual_seed(options.seed)
    model = RenderFormer(PRESETS[config.preset]()).to(device).train()
    model.transformer.rope_emb.requires_grad_(False)
    model.view_transformer.transformer.rope_emb.requires_grad_(False)
    state = TrainingState(model, config.learning_rate, config.weight_decay, config.average_decay)
    saved = options.out / "state.safetensors"
    options.out.mkdir(parents=True, exist_ok=True)
    if saved.is_file():
        state.load(saved)
    print(f"{sum(p.numel() for p in model.parameters()):,} parameters, step {state.step}", flush=True)
    mapper, perceptual = load_material_mapper(), perceptual_term()
    begin = last_save = time.monotonic()
    seconds, cooldown = options.minutes * 60, options.cooldown * 60
    totals: dict[str, float] = {}
    stage, samples = None, iter(())
    while (elapsed := time.monotonic() - begin) < seconds:
        if config.stage(state.step) != stage:
            stage = config.stage(state.step)
            samples = iter(stream(options.data, options.cache, mapper, stage, options.seed + state.step))
        left = min(1.0, (seconds - elapsed) / cooldown) if cooldown else 1.0
        rate = config.learning_rate * min(1.0, (state.step + 1) / config.warmup_steps) * left
        for _ in range(config.scenes_per_step):
            sample = next(samples).to(device)
            with torch.autocast(device.type, torch.bfloat16):
                losses = sample_loss(model, sample, perceptual)
            if losses["total"].isfinite():
                (losses["total"] / config.scenes_per_step).backward()
            for name, value in losses.items():
                totals[name] = totals.get(name, 0.0) + float(value.detach()) / (config.scenes_per_step * LOG_EVERY)
        torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip_norm)
        state.advance(rate)
        if state.step % LOG_EVERY == 0:
            record = {"step": state.step, "minutes": round((time.monotonic() - begin) / 60, 2)}
            record |= {name: round(value, 5) for name, value in totals.items()}
            with open(options.out / "log.jsonl", "a") as log:
                log.write(json.dumps(record) + "\n")
            print(record, flush=True)
            totals = {}
        if time.monotonic() - last_save > SAVE_SECONDS:
            _save(state, saved, options.out)
            last_save = time.monotonic()
    _save(state, saved, options.out)


def _save(state: TrainingState, saved: Path, out: Path) -> None:
    state.save(saved)
    save_small(out / "weights", state.model.config, state.average)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.train.network", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples, may still be growing")
    parser.add_argument("--cache", type=Path, help="prepared samples (default: DATA/../cache)")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name("small.json"))
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--cooldown", type=float, default=0.0, help="minutes at the end with a falling learning rate")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=0, help="processor threads (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.cache = options.cache or options.data.parent / "cache"
    with team(options.threads):
        train(options, TrainConfig.load(options.config))


if __name__ == "__main__":
    main()
