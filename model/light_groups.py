# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of each light group as a picture: light is linear, so a group is the scene with its lights alone.

    picture = sum over the groups of their light + the light of what is in no group

Groups are counted from 1, as RenderScene has them; row 0 of arrays of groups is what is in none.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from .light_passes import FAINT, RADIUS, Lobes
from .pictures import box_means
from .scene import Guides, RenderScene
from .scene_rays import share_rays


def environment_group(scene: RenderScene) -> int:
    return 0 if scene.environment_group is None else int(scene.environment_group[0])


def has_lights(scene: RenderScene, group: int) -> bool:
    is_sky_lit = scene.environment is not None and environment_group(scene) == group
    has_fire = scene.fire is not None and not group
    return is_sky_lit or has_fire or bool(scene.is_light[scene.light_groups == group].any())


def lit_by(scene: RenderScene, group: int) -> RenderScene:
    """The scene with the lights of one group alone. Its rays, and what they meet, are shared."""
    emission = np.where((scene.light_groups == group)[:, None], scene.emission, np.float32(0))
    environment = scene.environment if environment_group(scene) == group else None
    fire = None if group else scene.fire
    return _with_rays(scene, replace(scene, emission=emission, environment=environment, fire=fire))


def lit_by_negative(scene: RenderScene) -> RenderScene:
    """The scene with its negative lamps alone, as if they shone. Its rays, and what they meet, are shared."""
    dark = replace(scene, emission=np.zeros_like(scene.emission), environment=None, fire=None, negative=None)
    return _with_rays(scene, dark.appended(scene.negative))


def _with_rays(scene: RenderScene, lit: RenderScene) -> RenderScene:
    share_rays(scene, lit, np.zeros(3, np.float32), 1.0)
    return lit


def divide(picture: np.ndarray, shown: Guides, lobes: Lobes, sampled: np.ndarray, hits: Guides, scene: RenderScene,
           with_environment: bool) -> np.ndarray:
    """(G, H, W, 3) f32 light of G groups, which with that of no group make `picture` (H, W, 3), in its units.

    shown, lobes: guides and light of the picture, with the G + 1 estimates of Lobes.groups. sampled: (G, H, W, 3) light
    of each group in Cycles' session, noisy, emitters and world seen directly included; hits: guides of that session.
    with_environment: whether the picture shows the world behind it.

    Each kind of light is divided in its own proportions: traced light as the samples around a pixel have it, estimated
    light as the estimates, emitters as the samples of the pixel. Where those of a kind are unknown, it has those of
    all other light there, or in the last resort of the whole picture.
    """
    of_sky, dark = environment_group(scene), np.zeros_like(lobes.radiance)
    sampled = np.concatenate([dark[None], sampled])
    if of_sky:
        sampled[of_sky] -= hits.environment
    if has_lights(scene, 0):
        sampled[0] = hits.emission + (dark if hits.traced is None else hits.traced) - sampled.sum(0)
    emitters = _shares(sampled.clip(0))
    around = np.stack([box_means(light, RADIUS) for light in sampled - hits.emission * emitters])
    traced = dark if lobes.traced is None else lobes.traced
    light = shown.emission * emitters + traced * _shares(around.clip(0))
    if lobes.groups is not None:
        light += (lobes.radiance - traced).clip(0) * _shares(lobes.groups.clip(0))
    if with_environment:
        light[of_sky] += shown.environment
    shares, whole = _shares(light), light.sum((1, 2), keepdims=True)
    shares += (1 - shares.sum(0)) * whole / np.maximum(whole.sum(0), FAINT ** 2)
    return (picture * shares)[1:].astype(np.float32)


def _shares(light: np.ndarray) -> np.ndarray:
    """(K, H, W, 3) of which there are K, as shares of their sum.

    What has no light has the shares of the pixels around, from where smooth edges bring it some, as beside a holdout;
    0 if these have none.
    """
    total = light.sum(0)
    if (total <= FAINT ** 2).any():
        light = np.where(total <= FAINT ** 2, np.stack([box_means(own, RADIUS) for own in light]), light)
        total = light.sum(0)
    return light / np.maximum(total, FAINT ** 2)
