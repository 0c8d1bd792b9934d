# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' part of a view layer: first hits with direct light, alpha of holdouts, shadow catchers."""
from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...model import progress
from ...model.camera import sees
from ...model.first_hits import denoise_media
from ...model.light.specular.ends import add_path_ends
from ...model.scene import Guides, RenderScene, View
from ..convert.camera.lens import Lens
from ..cycles import session as cycles_session
from ..cycles.run import Passes
from ..cycles.session import PINHOLE, Catchers, Look
from ..progress.stages import ALPHA, CATCHERS, FIRST_HITS, SAMPLE_HITS
from ..settings import Light
from . import output
from .guides import guides_of_no_triangle, inside, make_guides
from .layer import Layer
from .optics import Optics
from .output import Catch

CYCLES_SHARE = 0.8  # of the first hits; the rest finds the triangles behind them


@dataclass
class Hits:
    """Of the whole picture of one view; opacity and catch as output.composite has them."""

    passes: Passes  # of cycles_session.render_views
    guides: Guides
    opacity: np.ndarray | None
    catch: Catch | None
    outside: np.ndarray | None = None  # (H, W) bool: pixels of a panorama that look nowhere; Cycles leaves them black

    @property
    def preview(self) -> np.ndarray:
        """(H, W, 3) radiance to show until the network is done: what was traced, or unlit colours."""
        guides = self.guides
        if guides.traced is not None:
            return guides.traced
        return guides.diffuse_color + guides.glossy_color + guides.transmission_color

    def combined(self, radiance: np.ndarray, exposure: float) -> np.ndarray:
        """(H, W, 4) the picture with that radiance of surfaces and volumes."""
        picture = output.composite(radiance, self.guides, self.opacity, self.catch, exposure)
        if self.outside is not None:
            picture[self.outside, 3] = 1
        return picture


def first_hits(layer: Layer, scene: RenderScene, views: dict[str, View], passes: dict[str, Passes]) -> dict[str, Hits]:
    """Those of the whole picture of each view, which `passes` (as in output.write_views) get as soon as they are known.

    The layer's optics become those of a pinhole if they are for nothing but glass, and no glass is seen.
    """
    opacity, catch, found = _opacity(layer, views), _catch(layer, views), {}
    with layer.plan.enter(FIRST_HITS):
        rendered = _session(layer, scene, layer.optics.look(), layer.optics.rays_of_all(layer.settings.guide_samples))
        for name, each in rendered.items():
            passes[name] |= output.first_hits(each, layer.settings.exposure)
        if layer.optics and layer.optics.samples == 1 and not any(
                each["transmission_color"].any() for each in rendered.values()):
            layer.optics = Optics()
            layer.plan.skip(SAMPLE_HITS)
        for number, (name, view) in enumerate(views.items()):
            each, outside = rendered[name], _outside(view)
            if layer.optics:
                guides = guides_of_no_triangle(inside(each, outside))
            else:
                with progress.part(*_share(CYCLES_SHARE, number, len(views))):
                    guides = _guides(layer, inside(each, outside), scene, view)
                each |= {key: getattr(guides, key) for key in denoise_media.PASSES}  # less noisy through smoke
                passes[name] |= output.first_hits(each, layer.settings.exposure)
            found[name] = Hits(each, guides, opacity[name], catch[name], outside)
    return found


def sample_hits(layer: Layer, scene: RenderScene, number: int) -> dict[str, tuple[View, Guides]]:
    """Views from the sample of that number on each lens, or from its middle, and their guides."""
    views, look, found, samples = layer.views(), PINHOLE, {}, layer.optics.lens
    if samples > 1:
        lenses = {eye.view: Lens.of(eye) for eye in layer.eyes()
                  if eye.camera.data.type != "PANO" and eye.camera.data.dof.use_dof}
        points = {name: lens.points(samples)[number] for name, lens in lenses.items()}
        views |= {name: lens.view(views[name], points[name]) for name, lens in lenses.items()}
        by_camera = {lens.camera.name_full: (lens, points[name]) for name, lens in lenses.items()}
        look = Look(place=functools.partial(_place, list(by_camera.values())))
    with layer.plan.enter(SAMPLE_HITS):
        rendered = _session(layer, scene, look, layer.optics.rays_of_each(layer.settings.guide_samples))
        for number, (name, view) in enumerate(views.items()):
            with progress.part(*_share(CYCLES_SHARE, number, len(views))):
                found[name] = view, _guides(layer, inside(rendered[name], _outside(view)), scene, view)
    return found


def _outside(view: View) -> np.ndarray | None:
    return None if view.panorama is None else ~sees(view)


def _share(begin: float, number: int, count: int) -> tuple[float, float]:
    """Of what is left from `begin` on, the part of one of several."""
    return tuple(begin + (1 - begin) * (number + end) / count for end in (0, 1))


def _place(lenses: list[tuple[Lens, np.ndarray]], override) -> None:
    for lens, point in lenses:
        lens.look_from(point, override)


def _session(layer: Layer, scene: RenderScene, look: Look, samples: int) -> dict[str, Passes]:
    """The passes of cycles_session.render_views."""
    settings = layer.settings
    lit_by = " and direct light" if settings.light is Light.TRACED else ""
    with layer.status.during_cycles(f"Camera rays{lit_by} {{}}", share=CYCLES_SHARE):
        return cycles_session.render_views(layer.engine, layer.depsgraph, samples=samples, look=look,
                                           light=settings.light, hazy=bool(scene.volumes), threads=settings.threads,
                                           report=layer.report)


def _guides(layer: Layer, rendered: dict[str, np.ndarray], scene: RenderScene, view: View) -> Guides:
    """What the network is told of a view, of whose first hits `rendered` are the passes."""
    with progress.part(0.0, 0.5):
        guides = make_guides(rendered, scene, view)
    if not layer.settings.guided:
        return guides
    with progress.part(0.5, 1.0):
        return add_path_ends(guides, scene, view)


def _opacity(layer: Layer, views: dict[str, View]) -> dict[str, np.ndarray | None]:
    """(H, W) alpha of an opaque film, in which holdouts cut holes; None of a transparent one."""
    if layer.settings.film_transparent:
        return dict.fromkeys(views)
    if not layer.optics.holes:
        return {name: np.ones((view.height, view.width), np.float32) for name, view in views.items()}
    with layer.plan.enter(ALPHA), layer.status.during_cycles("Alpha {}"):
        rendered = _of_all_samples(layer, Light.NONE, layer.optics.look()._replace(opaque=True))
    return {name: each["alpha"][..., 0] for name, each in rendered.items()}


def _catch(layer: Layer, views: Iterable[str]) -> dict[str, Catch | None]:
    """What shadow catchers show, if there are any."""
    if not layer.optics.catchers:
        return dict.fromkeys(views)
    look, settings, sessions = layer.optics.look(), layer.settings, []
    catching = look._replace(catchers=Catchers.CATCH, opaque=not settings.film_transparent)
    for light, asked in ((Light.NONE, look._replace(catchers=Catchers.CUT)), (Light.TRACED, catching)):
        with layer.plan.enter(CATCHERS), layer.status.during_cycles("Shadow catchers {}"):
            sessions.append(_of_all_samples(layer, light, asked))
    without, caught = sessions
    return {name: Catch(each["combined"], without[name]["alpha"][..., 0]) for name, each in caught.items()}


def _of_all_samples(layer: Layer, light: Light, look: Look) -> dict[str, Passes]:
    return cycles_session.render_views(
        layer.engine, layer.depsgraph, samples=layer.optics.rays_of_all(layer.settings.guide_samples), light=light,
        look=look, threads=layer.settings.threads, report=layer.report)
