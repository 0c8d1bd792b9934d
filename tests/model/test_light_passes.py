# SPDX-License-Identifier: GPL-3.0-or-later
"""Light passes add up to the picture, and traced light goes where the samples say."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model import pictures
from renderformer_v2.model.light_passes import LOBES, Lobes, light_passes
from renderformer_v2.model.scene import Guides

H, W = 12, 20


def guides(rng, traced):
    picture = lambda: rng.random((H, W, 3), np.float32)  # noqa: E731
    colors = [picture() for _ in LOBES]
    colors[2][:, :5] = 0      # nothing is transmitted there
    for color in colors:
        color[0] = 0          # what is seen there has no colour at all
        color[1] = 3e-5       # or one that half floats do not hold
    zero = np.zeros((H, W), np.float32)
    return Guides(picture(), picture(), *colors, picture(), picture(), zero, zero, zero.astype(np.int32),
                  np.zeros((H, W, 2), np.float32), traced=picture() if traced else None)


def recipe(passes, given):
    colors = (given.diffuse_color, given.glossy_color, given.transmission_color)
    return sum(color * (passes[f"{lobe}_direct"] + passes[f"{lobe}_indirect"])
               for lobe, color in zip(LOBES, colors)) + passes["volume_direct"] + passes["volume_indirect"]


@pytest.mark.parametrize("volumes", [False, True])
@pytest.mark.parametrize("traced", [False, True])
def test_passes_add_up_to_the_picture(traced, volumes):
    rng = np.random.default_rng(1)
    given = guides(rng, traced)
    direct, indirect = rng.random((2, 3, H, W, 3), np.float32)
    colors = np.stack([given.diffuse_color, given.glossy_color, given.transmission_color])
    arriving = given.traced if traced else (colors * direct).sum(0)
    radiance = arriving + (colors * indirect).sum(0) + rng.random((H, W, 3), np.float32) * 0.1
    names = [f"{lobe}_{part}" for lobe in (*LOBES, "volume") for part in ("direct", "indirect")]
    sampled = {name: rng.exponential(size=(H, W, 3)).astype(np.float32) for name in names} if traced else {}
    passes = light_passes(given, Lobes(radiance, given.traced, direct, indirect), sampled, volumes)
    assert set(passes) == set(names)
    assert all(np.isfinite(light).all() and light.min() >= 0 for light in passes.values())
    np.testing.assert_allclose(recipe(passes, given), radiance, rtol=1e-4, atol=1e-5)
    assert (passes["transmission_direct"][:, :5] == 0).all()
    assert passes["transmission_direct"].any() == traced  # as in Cycles, which counts what glass shows as indirect
    if not volumes and not traced:
        assert passes["volume_indirect"][2:].max() < 1e-5


def test_traced_light_keeps_the_proportions_of_the_samples():
    rng = np.random.default_rng(2)
    given = guides(rng, traced=True)
    flat = np.ones((H, W, 3), np.float32)
    for color in (given.diffuse_color, given.glossy_color, given.transmission_color):
        color[:] = 0.5
    dark = np.zeros((3, H, W, 3), np.float32)
    sampled = {f"{lobe}_{part}": 0 * flat for lobe in LOBES for part in ("direct", "indirect")}
    sampled |= {"diffuse_direct": 3 * flat, "glossy_indirect": flat}
    passes = light_passes(given, Lobes(given.traced, given.traced, dark, dark), sampled, volumes=False)
    np.testing.assert_allclose(0.5 * passes["diffuse_direct"], 0.75 * given.traced, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(0.5 * passes["glossy_indirect"], 0.25 * given.traced, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("traced", [False, True])
def test_light_of_rough_gloss_is_darker_and_its_colour_that_of_cycles(traced):
    given = replace(guides(np.random.default_rng(5), traced), glossy_kept=np.full((H, W), 0.4, np.float32))
    for color in (given.diffuse_color, given.glossy_color):
        color[:] = 0.5
    given.transmission_color[:] = 0
    light, dark = np.ones((3, H, W, 3), np.float32), np.zeros((3, H, W, 3), np.float32)
    names = [f"{lobe}_{part}" for lobe in LOBES for part in ("direct", "indirect")]
    sampled = dict.fromkeys(names, dark[0]) | {"diffuse_direct": light[0], "glossy_direct": 0.4 * light[0]}
    radiance = 0.7 * light[0]
    if traced:
        given.traced[:] = radiance
    lobes = Lobes(radiance, given.traced, dark if traced else light, dark)
    passes = light_passes(given, lobes, sampled if traced else {}, volumes=False)
    np.testing.assert_allclose(passes["diffuse_direct"], 1, rtol=1e-4)
    np.testing.assert_allclose(passes["glossy_direct"], 0.4, rtol=1e-4)
    np.testing.assert_allclose(recipe(passes, given), radiance, rtol=1e-4)


def test_denoised_light_where_no_sample_found_any_belongs_to_the_lobes():
    given = guides(np.random.default_rng(3), traced=True)
    dark = np.zeros((3, H, W, 3), np.float32)
    sampled = {f"{lobe}_{part}": dark[0] for lobe in (*LOBES, "volume") for part in ("direct", "indirect")}
    passes = light_passes(given, Lobes(given.traced, given.traced, dark, dark), sampled, volumes=True)
    np.testing.assert_allclose(recipe(passes, given), given.traced, rtol=1e-4, atol=1e-5)
    assert passes["volume_indirect"][2:].max() < 1e-5


def test_some_of_the_passes_have_the_light_that_they_have_among_all():
    rng = np.random.default_rng(4)
    given = guides(rng, traced=True)
    indirect, shares = rng.random((3, H, W, 3), np.float32), {"diffuse_direct": 0.6, "glossy_indirect": 0.4}
    colors = {"diffuse": given.diffuse_color, "glossy": given.glossy_color, "transmission": given.transmission_color}
    for color in colors.values():
        color[:] = 0.5
    smooth = np.broadcast_to(np.linspace(1, 2, W, dtype=np.float32)[:, None], (H, W, 3))
    given = replace(given, traced=smooth)
    sampled = {f"{lobe}_{part}": smooth * shares.get(f"{lobe}_{part}", 0) / colors[lobe]
               for lobe in LOBES for part in ("direct", "indirect")}
    lobes = Lobes(smooth + sum(color * light for color, light in zip(colors.values(), indirect)), smooth,
                  np.zeros_like(indirect), indirect)
    all_of_them = light_passes(given, lobes, sampled, volumes=False)
    some = light_passes(given, lobes, {name: sampled[name] for name in shares}, volumes=False)
    assert set(some) == set(shares)
    for name in shares:
        np.testing.assert_allclose(some[name], all_of_them[name], rtol=0.02, atol=1e-3)


def test_bands_do_not_show(monkeypatch):
    rng = np.random.default_rng(4)
    given = guides(rng, traced=True)
    dark = np.zeros((3, H, W, 3), np.float32)
    sampled = {f"{lobe}_{part}": rng.random((H, W, 3), np.float32) for lobe in LOBES for part in ("direct", "indirect")}
    lobes = Lobes(given.traced, given.traced, dark, dark)
    whole = light_passes(given, lobes, sampled, volumes=False)
    monkeypatch.setattr(pictures, "BAND_PIXELS", 3 * W)
    for name, light in light_passes(given, lobes, sampled, volumes=False).items():
        np.testing.assert_array_equal(light, whole[name], err_msg=name)
