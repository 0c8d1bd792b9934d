# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the passes of a session of what Cycles rendered: finite values, and light apart from what shines by itself."""
from __future__ import annotations

import numpy as np

from ...model.light_passes import LOBES
from ...model.pictures import HALF_MAX, box_sums
from .. import passes as pass_table
from ..convert.data.report import Report
from ..convert.shading.closure import BRIGHTEST
from ..frame_settings import Light
from .run import Passes
from .session_options import SessionOptions

BESIDE = 2           # pixels from an emitter, as far as the denoiser smooths its edge
MEDIA_ALBEDO = 0.01  # what media, which no colour pass shows, count as beside surfaces


def make_finite(rendered: Passes, report: Report) -> None:
    """Normalised vectors of no length are NaN in Cycles: it lets a pixel be black then, but not its passes.

    So surfaces with such a normal have no colour. Colours of surfaces end where the scene's do: beyond, light times
    them is no number.
    """
    is_black = ~np.isfinite(rendered["normal"]).all(axis=-1)
    for key, values in rendered.items():
        if not np.isfinite(values).all():
            report.approximated(key.replace("_", " ").title(),
                                "where Cycles' pass holds no number, 0 is taken: look for a Normal or Tangent of 0 in "
                                "materials")
            values = np.nan_to_num(values, posinf=HALF_MAX, neginf=-HALF_MAX)
        if key.endswith("_color") and (is_black.any() or values.max(initial=0) > BRIGHTEST):
            values = np.where(is_black[..., None], 0, values.clip(max=BRIGHTEST))
        rendered[key] = values


def separate_light(rendered: Passes, options: SessionOptions) -> None:
    """Replace the passes that Cycles `rendered` by those of session.render_views, in place."""
    camera, noisy = options.camera, pass_table.NOISY.key
    combined, visible = rendered["combined"], camera.visible_passes
    rendered["alpha"] = combined[..., 3:].copy()
    share = rendered.get(pass_table.SAMPLE_COUNT.key)
    rendered["samples"] = np.zeros_like(rendered["alpha"]) + options.sampling.counts(share)
    if options.is_denoised:
        noisy_light = _without(rendered, visible, noisy)
        rendered["noise"] = rendered.pop(noisy)[..., :3] - combined[..., :3]
    if options.light is not Light.ALL and camera.is_blurred and not options.catches_shadows:
        _denoise_visible(rendered, visible)
    if options.light is Light.TRACED:
        rendered["traced"] = _without(rendered, visible)
        if options.is_denoised:
            rendered["traced"] = _beside_emitters(rendered["traced"], noisy_light, rendered)
    elif options.light is Light.NONE and camera.is_blurred:  # no light: the rest is emission that noise left out
        rendered["emission"] = rendered["emission"] + _without(rendered, visible)
    if options.light is not Light.ALL and not options.catches_shadows:
        del rendered["combined"]


def _denoise_visible(rendered: Passes, visible: tuple[str, ...]) -> None:
    """Dim what is directly visible, which has the noise of a blur, to what the denoised picture leaves for it."""
    total = sum(rendered[name] for name in visible)
    share = np.where(total > 0, rendered["combined"][..., :3].clip(0) / np.where(total > 0, total, 1), 1).clip(max=1)
    for name in visible:
        rendered[name] = rendered[name] * share


def _without(rendered: Passes, visible: tuple[str, ...], picture: str = "combined") -> np.ndarray:
    """(H, W, 3) of the picture, without what is directly visible."""
    return (rendered[picture][..., :3] - sum(rendered[name] for name in visible)).clip(0)


def _beside_emitters(light: np.ndarray, noisy: np.ndarray, rendered: Passes) -> np.ndarray:
    """Denoised `light` (H, W, 3) of surfaces, beside emitters its median with `noisy` light and with that around.

    The denoiser smooths the edges of emitters, which their pass does not have: small ones would shine twice. The light
    beside them may be far above what is around it all the same, as in metal that they lie on. A second median, wider
    around, takes most of the noise that the first one leaves.
    """
    beside = box_sums(rendered["emission"].max(axis=-1, keepdims=True), BESIDE) > 0
    if not beside.any():
        return light
    albedo = MEDIA_ALBEDO + sum(rendered[f"{lobe}_color"] for lobe in LOBES)
    for radius in (1, 2):
        around = albedo * box_sums(noisy, radius) / box_sums(albedo, radius)
        noisy = around.clip(np.minimum(light, noisy), np.maximum(light, noisy))
    return np.where(beside, noisy, light)
