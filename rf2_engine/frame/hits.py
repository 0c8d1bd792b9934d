# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' part of a view layer: first hits with direct light, alpha of holdouts, shadow catchers."""
from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ...model import denoise_media, progress
from ...model.scene import Guides, RenderScene, View
from ..convert.camera.lens import Lens
from ..cycles import session as cycles_session
from ..cycles.session import PINHOLE, Catchers, Light, Look
from ..progress.stages import ALPHA, CATCHERS, FIRST_HITS, SAMPLE_HITS
from . import output
from .guides import guides_of_no_triangle, make_guides
from .layer import Layer
from .optics import Optics
from .output import Catch
from .reflections import with_ends

CYCLES_SHARE = 0.8  # of the first hits; the rest finds the triangles behind them


@dataclass
class Hits:
    """Of the whole picture; opacity and catch as output.composite has them."""

    passes: dict[str, np.ndarray]  # of cycles_session.render_passes
    guides: Guides
    opacity: np.ndarray | None
    catch: Catch | None

    @property
    def preview(self) -> np.ndarray:
        """(H, W, 3) radiance to show until the network is done: what was traced, or unlit colours."""
        guides = self.guides
        if guides.traced is not None:
            return guides.traced
        return guides.diffuse_color + guides.glossy_color + guides.transmission_color

    def combined(self, radiance: np.ndarray, exposure: float) -> np.ndarray:
        """(H, W, 4) the picture with that radiance of surfaces and volumes."""
        return output.composite(radiance, self.guides, self.opacity, self.catch, exposure)


def first_hits(layer: Layer, scene: RenderScene, view: View, passes: dict[str, np.ndarray]) -> Hits:
    """Those of the whole picture, which `passes` (as in output.write) get as soon as they are known.

    The layer's optics become those of a pinhole if they are for nothing but glass, and no glass is seen.
    """
    opacity, catch = _opacity(layer, view), _catch(layer)
    with layer.plan.enter(FIRST_HITS):
        rendered = _session(layer, scene, layer.optics.look(), layer.optics.rays_of_all(layer.settings.guide_samples))
        passes |= output.first_hits(rendered, layer.settings.exposure)
        if layer.optics and layer.optics.samples == 1 and not rendered["transmission_color"].any():
            layer.optics = Optics()
            layer.plan.skip(SAMPLE_HITS)
        if layer.optics:
            return Hits(rendered, guides_of_no_triangle(rendered), opacity, catch)
        with progress.part(CYCLES_SHARE, 1.0):
            guides = _guides(layer, rendered, scene, view)
        rendered |= {key: getattr(guides, key) for key in denoise_media.PASSES}  # through smoke these are less noisy
        passes |= output.first_hits(rendered, layer.settings.exposure)
        return Hits(rendered, guides, opacity, catch)


def sample_hits(layer: Layer, scene: RenderScene, point: np.ndarray | None) -> tuple[View, Guides]:
    """A view from a point of the lens, or from its middle, and its guides."""
    view, look = layer.view(), PINHOLE
    if point is not None:
        lens = Lens.of(layer.depsgraph)
        view, look = lens.view(view, point), Look(place=functools.partial(lens.look_from, point))
    with layer.plan.enter(SAMPLE_HITS):
        rendered = _session(layer, scene, look, layer.optics.rays_of_each(layer.settings.guide_samples))
        with progress.part(CYCLES_SHARE, 1.0):
            return view, _guides(layer, rendered, scene, view)


def _session(layer: Layer, scene: RenderScene, look: Look, samples: int) -> dict[str, np.ndarray]:
    """The passes of cycles_session.render_passes."""
    settings = layer.settings
    lit_by = " and direct light" if settings.light is Light.TRACED else ""
    with layer.status.during_cycles(f"Camera rays{lit_by} {{}}", share=CYCLES_SHARE):
        return cycles_session.render_passes(layer.engine, layer.depsgraph, samples=samples, look=look,
                                            light=settings.light, hazy=bool(scene.volumes), threads=settings.threads,
                                            report=layer.report)


def _guides(layer: Layer, rendered: dict[str, np.ndarray], scene: RenderScene, view: View) -> Guides:
    """What the network is told of a view, of whose first hits `rendered` are the passes."""
    with progress.part(0.0, 0.5):
        guides = make_guides(rendered, scene, view)
    if not layer.settings.guided:
        return guides
    with progress.part(0.5, 1.0):
        return with_ends(guides, scene, view)


def _opacity(layer: Layer, view: View) -> np.ndarray | None:
    """(H, W) alpha of an opaque film, in which holdouts cut holes; None of a transparent one."""
    if layer.settings.film_transparent:
        return None
    if not layer.optics.holes:
        return np.ones((view.height, view.width), np.float32)
    with layer.plan.enter(ALPHA), layer.status.during_cycles("Alpha {}"):
        return _of_all_samples(layer, Light.NONE, layer.optics.look()._replace(opaque=True))["alpha"][..., 0]


def _catch(layer: Layer) -> Catch | None:
    """What shadow catchers show, if there are any."""
    if not layer.optics.catchers:
        return None
    look, settings, sessions = layer.optics.look(), layer.settings, []
    catching = look._replace(catchers=Catchers.CATCH, opaque=not settings.film_transparent)
    for light, asked in ((Light.NONE, look._replace(catchers=Catchers.CUT)), (Light.TRACED, catching)):
        with layer.plan.enter(CATCHERS), layer.status.during_cycles("Shadow catchers {}"):
            sessions.append(_of_all_samples(layer, light, asked))
    without, caught = sessions
    return Catch(caught["combined"], without["alpha"][..., 0])


def _of_all_samples(layer: Layer, light: Light, look: Look) -> dict[str, np.ndarray]:
    return cycles_session.render_passes(
        layer.engine, layer.depsgraph, samples=layer.optics.rays_of_all(layer.settings.guide_samples), light=light,
        look=look, threads=layer.settings.threads, report=layer.report)
