# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.network --data DIR --out DIR --minutes M: train the bundled network on tools.datagen samples.

Resumes from DIR/state.safetensors, or from the one before it if that is damaged, and may run for days: the learning
rate stays constant after the warm-up and falls to zero during the last --cooldown minutes. DIR/weights holds the
running average, ready for `--weights DIR/weights`.
"""
from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import torch

from renderformer_v2.model.checkpoint import load_material_mapper, new_network, save_network
from renderformer_v2.model.guided.guides import FEATURES
from renderformer_v2.model.guided.light import decode_light
from renderformer_v2.model.guided.network import GuidedRenderFormer
from renderformer_v2.model.presets import PRESETS
from renderformer_v2.model.threads import team
from tools.arguments import whole_number

from .config import TrainConfig
from .errors import TrainingError
from .loader import stream
from .log import Log
from .losses import image_loss, lobe_loss, perceptual_term
from .samples import TrainingSample
from .start import start_from
from .state import TrainingState

LOG_EVERY = 50  # steps
DIFFUSE_ALONE = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1, 1)


def sample_loss(model: GuidedRenderFormer, sample: TrainingSample, perceptual) -> dict[str, torch.Tensor]:
    """Losses of all views of one scene."""
    guides = sample.view.guides
    light = decode_light(model.render_view(model.encode_scene(sample.inputs), sample.view), guides)
    # Traced hints hold the specular lobes' indirect light in part; diffuse light that has bounced they never hold.
    hinted = guides.features[:, FEATURES["hinted"], None] > 0
    unknown = guides.colors * torch.where(hinted, DIFFUSE_ALONE.to(guides.colors), 1.0)
    losses = {"image": image_loss(light["image"], sample.image, perceptual),
              "direct": lobe_loss(light["direct"], sample.direct, guides.colors),
              "indirect": lobe_loss(light["indirect"], sample.indirect, unknown)}
    return losses | {"total": sum(losses.values())}


def train(options: argparse.Namespace, config: TrainConfig) -> None:
    """Raises TrainingError when there is nothing to train with, or when training has gone wrong."""
    device = torch.device(options.device)
    torch.manual_seed(options.seed)
    model = new_network(PRESETS[config.preset]()).to(device).train()
    model.transformer.rope_emb.requires_grad_(False)
    model.view_transformer.transformer.rope_emb.requires_grad_(False)
    if options.start:
        start_from(model, options.start)
    state = TrainingState(model, config.learning_rate, config.weight_decay, config.average_decay)
    saved = options.out / "state.safetensors"
    options.out.mkdir(parents=True, exist_ok=True)
    state.resume(saved)
    print(f"{sum(p.numel() for p in model.parameters()):,} parameters, step {state.step}", flush=True)
    mapper, perceptual = load_material_mapper(), perceptual_term(device)
    log, begin = Log(options.out / "log.jsonl"), time.monotonic()
    last_save, seconds, cooldown = begin, options.minutes * 60, options.cooldown * 60
    stage, samples = None, iter(())
    while (elapsed := time.monotonic() - begin) < seconds:
        if config.stage(state.step) != stage:
            stage = config.stage(state.step)
            samples = stream(options.data, options.cache, mapper, stage, (options.seed, state.step), options.wait * 60)
        left = min(1.0, (seconds - elapsed) / cooldown) if cooldown else 1.0
        rate = config.learning_rate * min(1.0, (state.step + 1) / config.warmup_steps) * left
        scenes = []
        for _ in range(config.scenes_per_step):
            sample = next(samples).to(device)
            with torch.autocast(device.type, torch.bfloat16):
                scenes.append(sample_loss(model, sample, perceptual))
            (scenes[-1]["total"] / config.scenes_per_step).backward()
        if state.advance(rate, config.clip_norm):
            for losses in scenes:
                log.add(losses)
            if state.step % LOG_EVERY == 0:
                log.write(state.step, skipped=state.skipped)
        else:
            print(f"step {state.step + 1}: skipped, its gradients are not finite", flush=True)
        if time.monotonic() - last_save > options.save_every:
            _save(state, saved, options.out)
            last_save = time.monotonic()
    _save(state, saved, options.out)


def _save(state: TrainingState, saved: Path, out: Path) -> None:
    state.save(saved)
    save_network(out / "weights", state.model.config, state.average)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.network", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples, may still be growing")
    parser.add_argument("--cache", type=Path, help="prepared samples (default: DATA/../cache)")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--start", type=Path, metavar="WEIGHTS_DIR", help="begin with these weights: fine-tuning")
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name("rf2_small.json"))
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--cooldown", type=float, default=0.0, help="minutes at the end with a falling learning rate")
    parser.add_argument("--wait", type=float, default=5.0, help="minutes, for samples where there are none of use yet")
    parser.add_argument("--save-every", type=float, default=180.0, help="seconds")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.cache = options.cache or options.data.parent / "cache"
    try:
        with team(options.threads):
            train(options, TrainConfig.load(options.config))
    except TrainingError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
