# SPDX-License-Identifier: GPL-3.0-or-later
"""Compose the passes of the picture, and write them to Blender's render result."""
from __future__ import annotations

from collections.abc import Iterable
from contextlib import contextmanager
from typing import NamedTuple

import bpy
import numpy as np

from ...model import light_passes as model_light_passes
from ...model.errors import RenderCancelled
from ...model.light_passes import Lobes
from ...model.scene import Guides
from .. import passes as pass_table

EMITTED = ("emission", "environment")  # first-hit passes in units of radiance
ERROR_CHECKER = 16  # pixels
ERROR_COLORS = np.array([[0.6, 0.0, 0.4, 1.0], [0.05, 0.0, 0.04, 1.0]], np.float32)


class CaughtShadows(NamedTuple):
    """What shadow catchers show."""

    passes: dict[str, np.ndarray]  # of a session in which they catch; "combined" (H, W, 4) is premultiplied
    share: np.ndarray              # (H, W, 1) of what covers the pixel, that they are

    def over(self, rendered: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """`rendered` passes of Cycles, those of emitters and light with what is seen where catchers are."""
        return rendered | {key: np.where(self.share > 0, self.passes[key], pixels) for key, pixels in rendered.items()
                           if key in (*EMITTED, *pass_table.LIGHTING, "noise")}


def composite(radiance: np.ndarray, guides: Guides, opacity: np.ndarray | None, shadows: CaughtShadows | None,
              exposure: float) -> np.ndarray:
    """(H, W, 4) f32 Combined, premultiplied: surfaces and volumes + emitters seen directly + the world behind them.

    radiance: (H, W, 3) of surfaces and volumes. opacity: (H, W) alpha of an opaque film, 1 but where holdouts are;
    None of a transparent one.
    """
    color = radiance + guides.emission
    alpha = guides.alpha
    if opacity is not None:
        color, alpha = color + guides.environment, opacity
    picture = np.dstack([color, alpha])
    if shadows is not None:
        bounced = (1 - shadows.share) * (radiance - guides.traced).clip(0)  # of all else, which was not traced
        picture = np.where(shadows.share > 0, add_light(shadows.passes["combined"], bounced), picture)
    return (picture * (exposure, exposure, exposure, 1)).astype(np.float32)


def noisy(combined: np.ndarray, rendered: dict[str, np.ndarray], exposure: float) -> np.ndarray:
    """(H, W, 4) the picture with the noise that the denoiser removed from what Cycles `rendered`."""
    noise = rendered.get("noise", np.zeros_like(combined[..., :3]))
    return add_light(combined, noise * exposure)


def add_light(picture: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """(H, W, 4) a picture with more light (H, W, 3), and the same alpha."""
    return picture + np.pad(radiance, ((0, 0), (0, 0), (0, 1)))


def first_hit_passes(rendered: dict[str, np.ndarray], exposure: float) -> dict[str, np.ndarray]:
    """First hits as passes of the picture. Of them Cycles, too, exposes emission and environment alone."""
    return {key: pixels * exposure if key in EMITTED else pixels for key, pixels in rendered.items()
            if key not in pass_table.LIGHTING}


def light_passes(guides: Guides, lobes: Lobes, rendered: dict[str, np.ndarray], has_volumes: bool,
                 exposure: float) -> dict[str, np.ndarray]:
    """Light passes of the picture; `rendered` are the passes of Cycles' session, with the noisy light of each lobe."""
    sampled = {key: pixels for key, pixels in rendered.items() if key in pass_table.LIGHTING}
    passes = model_light_passes.light_passes(guides, lobes, sampled, has_volumes)
    return {key: light * exposure for key, light in passes.items()}


def write_views(engine: bpy.types.RenderEngine, layer: str, views: dict[str, dict[str, np.ndarray]]) -> None:
    """As passes.write, by view."""
    for view, passes in views.items():
        pass_table.write(engine, layer, passes, view)


@contextmanager
def unless_stopped(engine: bpy.types.RenderEngine, layer: str, views: Iterable[str]):
    """Give a dict of passes by view, as passes.write takes them, to be filled inside.

    If it ends without a picture, they alone remain: whatever Cycles or passes.write showed in Combined meanwhile is
    taken back. A Combined among the passes is what the user sees of the picture so far: it remains when they end the
    render, and not when an error does.
    """
    by_view: dict[str, dict[str, np.ndarray]] = {view: {} for view in views}
    try:
        yield by_view
    except BaseException as error:
        if not isinstance(error, RenderCancelled):
            for passes in by_view.values():
                passes.pop("combined", None)
        elif any("combined" in passes for passes in by_view.values()):
            engine.report({"INFO"}, "RenderFormer-V2 was stopped: the picture is as it was shown last, without all of "
                                    "the network's light")
        write_views(engine, layer, by_view)
        raise


def write_error(engine: bpy.types.RenderEngine, layer: str) -> None:
    """A magenta checkerboard: nobody takes it for a picture, and nobody waits for one in a black frame."""
    result = engine.begin_result(0, 0, engine.resolution_x, engine.resolution_y, layer=layer)
    y, x = np.indices((result.resolution_y, result.resolution_x)) // ERROR_CHECKER
    for p in result.layers[0].passes:
        if p.name == "Combined":
            p.rect.foreach_set(ERROR_COLORS[(x + y) % 2].ravel())
    engine.end_result(result)
