# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of each lobe as render passes, so that Cycles' compositing recipe gives the picture (docs/architecture.md).

    picture = sum over the lobes of albedo x (direct + indirect) + volume direct + volume indirect
              + emitters and environment that the camera sees directly
"""
from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from .pictures import HALF_MAX, bands, box_means
from .progress import steps
from .scene import Guides

LOBES = ("diffuse", "glossy", "transmission")
REMAINDER = "remainder"  # key of traced light that belongs to none of the requested passes
FAINT = 1e-4   # albedo below which half floats are too coarse to divide by
TRACE = 1e-6   # direct light that every lobe has at least, so that all traced light belongs to some lobe
RADIUS = 2     # pixels: samples are few and noisy, so their proportions are those of a square around the pixel


@dataclass(frozen=True)
class Lobes:
    """The light of one view by lobe: f32, world radiance, premultiplied, row 0 on top."""

    radiance: np.ndarray                # (H, W, 3), of the picture, as EncodedScene.view returns it
    traced: np.ndarray | None = None    # (H, W, 3), the part of it that is traced light; None if nothing was traced
    # (3, H, W, 3) light of LOBES before their albedos; `direct` is no part of the picture where light was traced
    direct: np.ndarray | None = None
    indirect: np.ndarray | None = None
    groups: np.ndarray | None = None    # (K, H, W, 3) estimated light of each light group, the ungrouped first
    latent: np.ndarray | None = None    # (H, W, C), from the network's decoder for the kernels of `antialiased`

    def scaled_to(self, radiance: np.ndarray) -> Lobes:
        """The same light in the same proportions, whose sum is another picture (H, W, 3)."""
        scale = radiance / np.maximum(self.radiance, FAINT ** 2)
        return Lobes(radiance, **{name: light * scale for name in ("traced", "direct", "indirect", "groups")
                                  if (light := getattr(self, name)) is not None})

    def without(self, taken: np.ndarray) -> Lobes:
        """What is left where lamps of negative strength take light (H, W, 3) away, never less than black."""
        return replace(self.scaled_to((self.radiance - taken).clip(0)), latent=self.latent)

    def rows(self, rows: slice) -> Lobes:
        """Some rows of the picture; shared memory."""
        return Lobes(**{f.name: x[..., rows, :, :] for f in fields(self) if (x := getattr(self, f.name)) is not None})


class MeanLobes:
    """The mean light of one picture over several points on the lens or moments of the shutter."""

    def __init__(self) -> None:
        self._count, self._sums = 0, {}

    def add(self, lobes: Lobes, guides: Guides) -> None:
        """The light of one of them, with its own guides."""
        albedo = _lobe_albedo(guides)
        light = {"estimated": lobes.radiance - (0 if lobes.traced is None else lobes.traced)}
        light |= {name: x * albedo for name, x in (("direct", lobes.direct), ("indirect", lobes.indirect))
                  if x is not None}
        light |= {} if lobes.groups is None else {"groups": lobes.groups}
        self._count += 1
        self._sums = {name: x + self._sums.get(name, 0) for name, x in light.items()}

    def mean(self, guides: Guides) -> Lobes:
        """With the albedos and the traced light of `guides`, which are those of the whole picture."""
        means = {name: x / self._count for name, x in self._sums.items()}
        albedo = _lobe_albedo(guides)
        lobes = {name: means[name] / np.maximum(albedo, FAINT) for name in ("direct", "indirect") if name in means}
        return Lobes(means["estimated"] + (0 if guides.traced is None else guides.traced), guides.traced,
                     groups=means.get("groups"), **lobes)


def light_passes(guides: Guides, lobes: Lobes, sampled: dict[str, np.ndarray],
                 volumes: bool) -> dict[str, np.ndarray]:
    """{"diffuse_direct": (H, W, 3) f32, ..., "volume_indirect"}, of which the recipe makes `lobes.radiance`.

    sampled: traced light by pass (keys as returned) as the samples have it. Traced light was denoised as a whole and
    its sum is kept; `sampled` says how it divides among the passes. Estimated light adds the indirect light of lobes,
    and light of no lobe, which goes to "volume_indirect" if there are `volumes`, else evenly to all lobes. What no
    albedo can be multiplied with goes to "volume_indirect" too. Without traced light `sampled` is not used, all light
    is estimated, and "volume_direct" is black.
    If `sampled` has some of the passes only, these are returned without "volume_indirect", and sum to less than the
    picture.
    """
    parts = [{name: light[inner] for name, light in _light_passes(
        guides.rows(outer), lobes.rows(outer), {name: x[outer] for name, x in sampled.items()}, volumes).items()}
        for outer, inner in steps(bands(*guides.alpha.shape, margin=RADIUS))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _light_passes(guides: Guides, lobes: Lobes, sampled: dict[str, np.ndarray],
                  volumes: bool) -> dict[str, np.ndarray]:
    albedo, kept = _pass_albedo(guides), dict.fromkeys(LOBES, 1)
    if guides.glossy_kept is not None:  # Cycles' light of the lobe is that much darker, not its colour
        kept["glossy"] = guides.glossy_kept[..., None]
    light = {f"{lobe}_indirect": lobes.indirect[i] * kept[lobe] for i, lobe in enumerate(LOBES)}
    if lobes.traced is None:
        light |= {f"{lobe}_direct": lobes.direct[i] * kept[lobe] for i, lobe in enumerate(LOBES)}
        # Most glass has two sides, and Cycles counts as indirect what is seen through both.
        through = light.pop("transmission_direct")
        light |= {"transmission_direct": np.zeros_like(through),
                  "transmission_indirect": light["transmission_indirect"] + through}
    else:
        for name, share in _divide_traced(lobes.traced, albedo, sampled, volumes).items():
            light[name] = light.get(name, 0) + share
        light = {f"{lobe}_direct": np.zeros_like(lobes.radiance) for lobe in LOBES} | light
    light.setdefault("volume_direct", np.zeros_like(lobes.radiance))
    light.pop("volume_indirect", None)  # the difference to the picture, below
    if not volumes:
        missing = lobes.radiance - _recipe(light, albedo)
        total_albedo = sum(albedo[f"{lobe}_indirect"] for lobe in LOBES)
        for lobe in LOBES:
            light[f"{lobe}_indirect"] = light[f"{lobe}_indirect"] + missing.clip(0) / np.maximum(total_albedo, FAINT)
    light |= {name: np.where(a > FAINT, light[name].clip(0, HALF_MAX), 0) for name, a in albedo.items()}
    if REMAINDER in light:
        return {name: light[name] for name in sampled}
    return light | {"volume_indirect": (lobes.radiance - _recipe(light, albedo)).clip(0)}


def _recipe(light: dict[str, np.ndarray], albedo: dict[str, np.ndarray]) -> np.ndarray:
    """The picture of these light passes."""
    return sum(light[name] * albedo.get(name, 1) for name in light)


def _lobe_albedo(guides: Guides) -> np.ndarray:
    """(3, H, W, 3) of LOBES, of estimated light."""
    return np.stack([guides.diffuse_color, guides.glossy_albedo, guides.transmission_color])


def _pass_albedo(guides: Guides) -> dict[str, np.ndarray]:
    """Albedo by light pass, as Cycles' passes have it; passes of volumes have none."""
    albedos = zip(LOBES, (guides.diffuse_color, guides.glossy_color, guides.transmission_color), strict=True)
    return {f"{lobe}_{part}": albedo for lobe, albedo in albedos for part in ("direct", "indirect")}


def _divide_traced(traced: np.ndarray, albedo: dict[str, np.ndarray], sampled: dict[str, np.ndarray],
                   volumes: bool) -> dict[str, np.ndarray]:
    """`traced` (H, W, 3) as light passes, before their albedos, in the proportions of `sampled`, and the REMAINDER."""
    light = {}
    for name, noisy in sampled.items():
        a = albedo.get(name, np.ones_like(noisy))
        light[name] = box_means(noisy * a, RADIUS) / np.maximum(box_means(a, RADIUS), FAINT)
        if name.endswith("_direct") and name in albedo:
            light[name] += TRACE
    total = np.maximum(_recipe(light, albedo), TRACE * FAINT)
    if albedo.keys() | ({"volume_direct", "volume_indirect"} if volumes else set()) <= sampled.keys():
        return {name: share * traced / total for name, share in light.items()}
    total = np.maximum(total, box_means(traced, RADIUS))
    light = {name: share * traced / total for name, share in light.items()}
    return light | {REMAINDER: traced - _recipe(light, albedo)}
