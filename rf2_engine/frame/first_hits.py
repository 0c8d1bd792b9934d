# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' part of a view layer: first hits with direct light, alpha of holdouts, shadow catchers."""
from __future__ import annotations

import functools
import time
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from ...model import progress
from ...model.camera import visible_pixels
from ...model.first_hits import denoise_media
from ...model.first_hits.from_passes import clear_outside, guides_from_passes, guides_without_triangles
from ...model.first_hits.sheets import through_sheets
from ...model.light.specular.ends import add_path_ends
from ...model.light_passes import Lobes
from ...model.scene import Guides, RenderScene, View
from ..convert.camera.lens import Lens
from ..convert.meshes.nearest import NearestTriangles
from ..cycles import growing
from ..cycles import session as cycles_session
from ..cycles.overrides import Overrides
from ..cycles.run import Passes
from ..cycles.session_options import PINHOLE, CameraModel, Catchers, SessionOptions
from ..frame_settings import Light
from ..passes import SHADOW_CATCHER
from ..progress.stages import ALPHA, CATCHERS, FIRST_HITS, SAMPLE_HITS
from ..sampling import Sampling
from . import output
from .layer import Layer
from .optics import Optics
from .output import CaughtShadows

CYCLES_SHARE = 0.8  # of the time for first hits; the rest finds the triangles behind them


@dataclass
class FirstHits:
    """First hits of the whole picture of one view; opacity and shadows as in output.composite."""

    passes: Passes  # of cycles_session.render_views, where there are shadow catchers with what is seen (output.py)
    guides: Guides
    opacity: np.ndarray | None
    shadows: CaughtShadows | None
    outside: np.ndarray | None = None  # (H, W) bool: pixels of a panorama that look nowhere; Cycles leaves them black

    @property
    def preview(self) -> np.ndarray:
        """(H, W, 3) radiance to show until the network is done: traced light, or unlit colours."""
        guides = self.guides
        if guides.traced is not None:
            return guides.traced
        return guides.diffuse_color + guides.glossy_color + guides.transmission_color

    def composite(self, radiance: np.ndarray, exposure: float) -> np.ndarray:
        """(H, W, 4) Combined with that radiance of surfaces and volumes."""
        picture = output.composite(radiance, self.guides, self.opacity, self.shadows, exposure)
        if self.outside is not None:
            picture[self.outside, 3] = 1
        return picture

    def without_catchers(self, lobes: Lobes) -> tuple[Guides, Lobes]:
        """The guides and light that passes are made of, without the light of shadow catchers.

        As in Cycles' passes, shadow catchers have colours and emission, but no light; an opaque film has the world
        behind them, without the shadows that Combined has.
        """
        if self.shadows is None:
            return self.guides, lobes
        guides = replace(self.guides, **{key: self.passes[key] for key in output.EMITTED})
        visible = guides.emission if self.opacity is None else guides.emission + guides.environment
        return guides, lobes.scaled_to((self.composite(lobes.radiance, 1.0)[..., :3] - visible).clip(0))


def render_first_hits(layer: Layer, scene: RenderScene, views: dict[str, View],
                      passes: dict[str, Passes]) -> tuple[dict[str, FirstHits], Optics]:
    """First hits of the whole picture by view, and the optics that the picture needs.

    `passes` (as in output.write_views) get the first hits as soon as they are known. The optics become those of a
    pinhole if they were for nothing but glass, and no glass is visible.
    """
    optics, settings = layer.optics, layer.settings
    opacity, catching, hits = _render_opacity(layer, views), _render_catchers(layer, views), {}
    with layer.plan.enter(FIRST_HITS):
        rendered = _run_session(layer, scene, _film(layer), optics.rays_of_picture(settings.sampling), views)
        for name, view_passes in rendered.items():
            passes[name] |= output.first_hit_passes(view_passes, settings.exposure)
            passes[name] |= _shadow_catcher_pass(catching[name], view_passes)
        if optics and optics.samples == 1 and not any(
                view_passes["transmission_color"].any() for view_passes in rendered.values()):
            optics = Optics()
            layer.plan.skip(SAMPLE_HITS)
        for number, (name, view) in enumerate(views.items()):
            view_passes, outside = rendered[name], _outside(view)
            if optics:
                guides = guides_without_triangles(clear_outside(view_passes, outside))
            else:
                with progress.part(*_remaining_share(CYCLES_SHARE, number, len(views))):
                    guides = _make_guides(layer, clear_outside(view_passes, outside), scene, view)
                view_passes |= {key: getattr(guides, key) for key in denoise_media.PASSES}  # less noisy through smoke
            if shadows := catching[name] and _caught_shadows(*catching[name], guides.alpha[..., None]):
                view_passes = shadows.over(view_passes)
            passes[name] |= output.first_hit_passes(view_passes, settings.exposure)
            hits[name] = FirstHits(view_passes, guides, opacity[name], shadows, outside)
    return hits, optics


def render_sample_hits(layer: Layer, scene: RenderScene, optics: Optics,
                       number: int) -> dict[str, tuple[View, Guides]]:
    """The view from the sample of that number on the lens, or from the lens' middle, and its guides, by view."""
    views, camera, hits, samples = layer.views(), PINHOLE, {}, optics.lens_samples
    if samples > 1:
        lenses = {eye.view: Lens.of(eye) for eye in layer.eyes()
                  if eye.camera.data.type != "PANO" and eye.camera.data.dof.use_dof}
        points = {name: lens.points(samples)[number] for name, lens in lenses.items()}
        views |= {name: lens.view(views[name], points[name]) for name, lens in lenses.items()}
        by_camera = {lens.camera.name_full: (lens, points[name]) for name, lens in lenses.items()}
        camera = CameraModel(move_cameras=functools.partial(_move_to_samples, list(by_camera.values())))
    with layer.plan.enter(SAMPLE_HITS):
        rendered = _run_session(layer, scene, camera, optics.rays_of_sample(layer.settings.sampling))
        for index, (name, view) in enumerate(views.items()):
            with progress.part(*_remaining_share(CYCLES_SHARE, index, len(views))):
                hits[name] = view, _make_guides(layer, clear_outside(rendered[name], _outside(view)), scene, view)
    return hits


def make_guides(passes: Passes, scene: RenderScene, view: View) -> Guides:
    """guides_from_passes, with Blender's search for the nearest triangles."""
    return guides_from_passes(passes, scene, view, _nearest_triangles)


def _nearest_triangles(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(k,) index of the one of triangles (N, 3, 3) that is nearest to each of points (k, 3)."""
    corners = triangles.astype(np.float64).reshape(-1, 3)
    return NearestTriangles(corners, np.arange(len(corners)).reshape(-1, 3)).nearest(points)


def _make_guides(layer: Layer, passes: Passes, scene: RenderScene, view: View) -> Guides:
    """The guides of a view, with the ends of specular paths if the network reads them."""
    with progress.part(0.0, 0.5):
        guides = make_guides(passes, scene, view)
    if not layer.settings.follows_specular_paths:
        return guides
    with progress.part(0.5, 1.0):
        return add_path_ends(through_sheets(guides, scene, view), scene, view)


def _film(layer: Layer) -> CameraModel:
    """The camera of the picture. What a blurred film shows of the world is denoised with all else if it is opaque."""
    optics, camera = layer.optics, layer.optics.camera_model()
    cuts_holes = layer.settings.film_transparent or optics.holdouts or optics.shadow_catchers
    return camera._replace(opaque_film=camera.is_blurred and not cuts_holes)


def _outside(view: View) -> np.ndarray | None:
    return None if view.panorama is None else ~visible_pixels(view)


def _remaining_share(begin: float, number: int, count: int) -> tuple[float, float]:
    """Begin and end of the part for one of several, of what remains of 1 after `begin`."""
    return tuple(begin + (1 - begin) * (number + end) / count for end in (0, 1))


def _move_to_samples(lenses: list[tuple[Lens, np.ndarray]], override: Overrides) -> None:
    for lens, point in lenses:
        lens.look_from(point, override)


def _run_session(layer: Layer, scene: RenderScene, camera: CameraModel, sampling: Sampling,
                 shown_views: dict[str, View] | None = None) -> dict[str, Passes]:
    """The passes of cycles_session.render_views.

    shown_views: those of the picture, if the light that Cycles traces is to be visible meanwhile.
    """
    settings, stack, most = layer.settings, ExitStack(), sampling.most
    with_light = " and direct light" if settings.light is Light.TRACED else ""
    with stack, layer.status.during_cycles(f"Camera rays{with_light} {{}}", share=CYCLES_SHARE) as status:
        if shown_views and settings.light is Light.TRACED:
            view = next(iter(shown_views.values()))
            stack.enter_context(growing.announced(growing.CyclesPicture(
                layer.name, view.width, view.height, 0.0, functools.partial(status.samples, most), most,
                time.perf_counter(), *layer.corner, tuple(shown_views), is_reference=False)))
        return _render_views(layer, SessionOptions(sampling, settings.light, camera, has_volumes=bool(scene.volumes),
                                                   threads=settings.threads, groups=layer.light_groups))


def _render_views(layer: Layer, options: SessionOptions) -> dict[str, Passes]:
    return cycles_session.render_views(layer.engine, layer.depsgraph, options, layer.report)


def _render_opacity(layer: Layer, views: dict[str, View]) -> dict[str, np.ndarray | None]:
    """(H, W) alpha of an opaque film, in which holdouts cut holes; None of a transparent one."""
    if layer.settings.film_transparent:
        return dict.fromkeys(views)
    if not layer.optics.holdouts:
        return {name: np.ones((view.height, view.width), np.float32) for name, view in views.items()}
    with layer.plan.enter(ALPHA), layer.status.during_cycles("Alpha {}"):
        rendered = _render_all_samples(layer, Light.NONE, layer.optics.camera_model()._replace(opaque_film=True))
    return {name: passes["alpha"][..., 0] for name, passes in rendered.items()}


def _render_catchers(layer: Layer, views: Iterable[str]) -> dict[str, tuple[Passes, np.ndarray] | None]:
    """If there are shadow catchers, the passes with what they show, and (H, W, 1) the coverage by everything else."""
    if not layer.optics.shadow_catchers:
        return dict.fromkeys(views)
    camera, settings, sessions = layer.optics.camera_model(), layer.settings, []
    cut = camera._replace(catchers=Catchers.CUT)
    catching = camera._replace(catchers=Catchers.CATCH, opaque_film=not settings.film_transparent)
    for light, session_camera in ((Light.NONE, cut), (Light.TRACED, catching)):
        with layer.plan.enter(CATCHERS), layer.status.during_cycles("Shadow catchers {}"):
            sessions.append(_render_all_samples(layer, light, session_camera))
    without, caught = sessions
    return {name: (passes, without[name]["alpha"]) for name, passes in caught.items()}


def _caught_shadows(passes: Passes, coverage: np.ndarray, alpha: np.ndarray) -> CaughtShadows:
    """What the shadow catchers of a view show; alpha (H, W, 1) is the coverage with them.

    Along their edges before the world the picture is as the samples have it: there the denoiser leaves dashes.
    """
    share = ((alpha - coverage) / alpha.clip(1e-6)).clip(0, 1)
    noise = passes.get("noise", np.zeros_like(passes["emission"]))
    restored = np.where((share > 0) & (coverage == 0) & (alpha < 1), noise, 0)
    combined = output.add_light(passes["combined"], restored)
    return CaughtShadows(passes | {"combined": combined, "noise": noise - restored}, share)


def _shadow_catcher_pass(catching: tuple[Passes, np.ndarray] | None, rendered: Passes) -> Passes:
    """The pass, 1 where nothing catches; with another Light there is none in the render result to be filled."""
    if catching is not None and SHADOW_CATCHER.key in catching[0]:
        return {SHADOW_CATCHER.key: catching[0][SHADOW_CATCHER.key]}
    return {SHADOW_CATCHER.key: np.broadcast_to(np.float32(1), rendered["emission"].shape)}


def _render_all_samples(layer: Layer, light: Light, camera: CameraModel) -> dict[str, Passes]:
    sampling = layer.optics.rays_of_picture(layer.settings.sampling)
    return _render_views(layer, SessionOptions(sampling, light, camera, threads=layer.settings.threads))
