# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of each lobe as render passes, so that Cycles' compositing recipe gives the picture (docs/architecture.md).

    picture = sum over the lobes of colour x (direct + indirect) + volume direct + volume indirect
              + what is seen directly of emitters and the world
"""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .color import HALF_MAX
from .pictures import bands, box_means
from .scene import Guides

LOBES = ("diffuse", "glossy", "transmission")
OTHERS = "others"  # traced light that nobody wants to have apart
FAINT = 1e-4   # half floats are too coarse for a colour below this: its light is not taken apart
TRACE = 1e-6   # direct light that every lobe has at least, so that all traced light belongs to some lobe
RADIUS = 2     # pixels: shares are those of a square around the pixel, for samples are few and noisy


@dataclass(frozen=True)
class Lobes:
    """What a network makes of one view: f32, world radiance, premultiplied, row 0 on top."""

    radiance: np.ndarray                # (H, W, 3), as EncodedScene.view gives it
    traced: np.ndarray | None = None    # (H, W, 3), what of it is traced light; None = nothing was traced
    # (3, H, W, 3) light of LOBES before their colours, of guided networks; `direct` is not in the picture where light
    # was traced
    direct: np.ndarray | None = None
    indirect: np.ndarray | None = None

    def scaled_to(self, radiance: np.ndarray) -> Lobes:
        """The same light in the same proportions, whose sum is another picture (H, W, 3)."""
        scale = radiance / np.maximum(self.radiance, FAINT ** 2)
        return Lobes(radiance, **{name: light * scale for name in ("traced", "direct", "indirect")
                                  if (light := getattr(self, name)) is not None})

    def rows(self, rows: slice) -> Lobes:
        """Those of a part of the picture's rows; shared memory."""
        return Lobes(**{f.name: x[..., rows, :, :] for f in fields(self) if (x := getattr(self, f.name)) is not None})


class MeanLobes:
    """What a network makes of one picture that was seen from several places, or at several moments."""

    def __init__(self) -> None:
        self._count, self._sums = 0, {}

    def add(self, lobes: Lobes, guides: Guides) -> None:
        """`lobes` of one view with its own `guides`."""
        colors = _lobe_colors(guides)
        light = {"added": lobes.radiance - (0 if lobes.traced is None else lobes.traced)}
        light |= {name: x * colors for name, x in (("direct", lobes.direct), ("indirect", lobes.indirect))
                  if x is not None}
        self._count += 1
        self._sums = {name: x + self._sums.get(name, 0) for name, x in light.items()}

    def under(self, guides: Guides) -> Lobes:
        """The mean, with the colours and the traced light of `guides`, which are those of the whole picture."""
        mean = {name: x / self._count for name, x in self._sums.items()}
        colors = _lobe_colors(guides)
        lobes = {name: x / np.maximum(colors, FAINT) for name, x in mean.items() if name != "added"}
        return Lobes(mean["added"] + (0 if guides.traced is None else guides.traced), guides.traced, **lobes)


def light_passes(guides: Guides, lobes: Lobes, sampled: dict[str, np.ndarray],
                 volumes: bool) -> dict[str, np.ndarray]:
    """{"diffuse_direct": (H, W, 3) f32, ..., "volume_indirect"}, which make `lobes.radiance` by the recipe.

    Traced light was denoised as a whole, and its sum stays what it is: `sampled`, the same light by pass as the samples
    found it (keys as returned), says how it divides among the passes. The network adds the indirect light of its lobes,
    and light of no lobe: "volume_indirect" if there are `volumes`, else the same indirect light for every lobe. What no
    colour can be multiplied with is in "volume_indirect" as well. Without traced light `sampled` is not looked at, all
    is the network's, and "volume_direct" is black.
    `sampled` may have some of the passes alone. Those are returned then, and make less than the picture; without
    "volume_indirect", which is what all others leave.
    """
    parts = [{name: light[inner] for name, light in _light_passes(
        guides.rows(outer), lobes.rows(outer), {name: x[outer] for name, x in sampled.items()}, volumes).items()}
        for outer, inner in bands(*guides.alpha.shape, margin=RADIUS)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _light_passes(guides: Guides, lobes: Lobes, sampled: dict[str, np.ndarray],
                  volumes: bool) -> dict[str, np.ndarray]:
    colors = _colors(guides)
    light = {f"{lobe}_indirect": lobes.indirect[i] for i, lobe in enumerate(LOBES)}
    if lobes.traced is None:
        light |= {f"{lobe}_direct": lobes.direct[i] for i, lobe in enumerate(LOBES)}
    else:
        for name, share in _divided(lobes.traced, colors, sampled, volumes).items():
            light[name] = light.get(name, 0) + share
        light = {f"{lobe}_direct": np.zeros_like(lobes.radiance) for lobe in LOBES} | light
    light.setdefault("volume_direct", np.zeros_like(lobes.radiance))
    light.pop("volume_indirect", None)  # it is what the others leave
    if not volumes:
        left, color = lobes.radiance - _picture(light, colors), sum(colors[f"{lobe}_indirect"] for lobe in LOBES)
        for lobe in LOBES:
            light[f"{lobe}_indirect"] = light[f"{lobe}_indirect"] + left.clip(0) / np.maximum(color, FAINT)
    light |= {name: np.where(color > FAINT, light[name].clip(0, HALF_MAX), 0) for name, color in colors.items()}
    if OTHERS in light:
        return {name: light[name] for name in sampled}
    return light | {"volume_indirect": (lobes.radiance - _picture(light, colors)).clip(0)}


def _picture(light: dict[str, np.ndarray], colors: dict[str, np.ndarray]) -> np.ndarray:
    """What the recipe makes of these light passes."""
    return sum(light[name] * colors.get(name, 1) for name in light)


def _lobe_colors(guides: Guides) -> np.ndarray:
    """(3, H, W, 3) of LOBES."""
    return np.stack([guides.diffuse_color, guides.glossy_color, guides.transmission_color])


def _colors(guides: Guides) -> dict[str, np.ndarray]:
    """What each light pass is multiplied with, if anything is."""
    colors = zip(LOBES, _lobe_colors(guides), strict=True)
    return {f"{lobe}_{part}": color for lobe, color in colors for part in ("direct", "indirect")}


def _divided(traced: np.ndarray, colors: dict[str, np.ndarray], sampled: dict[str, np.ndarray],
             volumes: bool) -> dict[str, np.ndarray]:
    """`traced` (H, W, 3) as light of passes, before their colours, in the proportions of `sampled`, and the OTHERS."""
    light = {}
    for name, noisy in sampled.items():
        color = colors.get(name, np.ones_like(noisy))
        light[name] = box_means(noisy * color, RADIUS) / np.maximum(box_means(color, RADIUS), FAINT)
        if name.endswith("_direct") and name in colors:
            light[name] += TRACE
    whole = np.maximum(_picture(light, colors), TRACE * FAINT)
    if colors.keys() | ({"volume_direct", "volume_indirect"} if volumes else set()) <= sampled.keys():
        return {name: share * traced / whole for name, share in light.items()}
    whole = np.maximum(whole, box_means(traced, RADIUS))
    light = {name: share * traced / whole for name, share in light.items()}
    return light | {OTHERS: traced - _picture(light, colors)}
