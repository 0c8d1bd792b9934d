# SPDX-License-Identifier: GPL-3.0-or-later
"""What is done for a view layer of a frame, once, or for every sample on its lens and in its shutter."""
from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...model import progress
from ...model.guided.silhouettes import blended
from ...model.lobes import Lobes, MeanLobes
from ...model.scene import Guides, RenderScene, View
from ..convert.camera.camera import convert_camera
from ..convert.camera.framing import Framing
from ..convert.camera.lens import Lens
from ..convert.report import Report
from ..convert.scene import convert, fitted
from ..cycles import session as cycles_session
from ..cycles.bake import Baker
from ..cycles.session import PINHOLE, Catchers, Light, Look
from ..cycles.world import CyclesWorld
from ..progress.status import Status
from ..settings import FrameSettings
from . import model_cache, shutter
from .guides import make_guides
from .optics import Optics
from .output import SHINING, Catch
from .rectangle import Border
from .reflections import with_ends
from .shot import Shot

CYCLES_SHARE = 0.8  # of the first hits; the rest finds the triangles behind them


@dataclass
class Layer:
    engine: bpy.types.RenderEngine
    depsgraph: bpy.types.Depsgraph
    settings: FrameSettings
    optics: Optics
    border: Border | None
    status: Status
    report: Report
    lit: bool  # whether the light of each lobe is wanted
    framing: Framing | None = None  # once the scene was converted

    def view(self) -> View:
        """From the middle of the lens."""
        return convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, self.border,
                              self.report)

    def scene(self) -> RenderScene:
        """What a shutter sees at other moments of the frame is fitted as the frame is."""
        if self.framing is not None:
            return self._converted(lambda own: self.framing)
        shot = Shot.of(self.depsgraph, self.settings, self.engine.resolution_x, self.engine.resolution_y)
        unknown = shot.unknown()
        begin = len(unknown) / (len(unknown) + 1)
        if unknown:
            with progress.part(0.0, begin), shutter.clock(self.engine, self.depsgraph) as move_to:
                shot.look_ahead(unknown, move_to, self._fitted)

        def steady(own: Framing) -> Framing:
            self.framing = shot.settled(own)
            return self.framing
        with progress.part(begin, 1.0):
            scene = self._converted(steady)
        shot.remember()
        return scene

    def _converted(self, steady: Callable[[Framing], Framing]) -> RenderScene:
        with Baker(self.depsgraph) if self.settings.bake_unknown else nullcontext() as baker:
            return convert(self.depsgraph, self._whole(), token_budget=self.settings.token_budget,
                           max_edge=self.settings.max_edge, report=self.report, steady=steady,
                           by_cycles=CyclesWorld(self.engine, self.depsgraph, self.status), baker=baker)

    def _fitted(self) -> Framing:
        return fitted(self.depsgraph, self._whole(), token_budget=self.settings.token_budget,
                      max_edge=self.settings.max_edge,
                      by_cycles=CyclesWorld(self.engine, self.depsgraph, self.status))

    def _whole(self) -> View:
        return convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, None)

    def first_hits(self, scene: RenderScene, look: Look, samples: int) -> dict[str, np.ndarray]:
        """The passes of cycles_session.render_passes."""
        lit_by = " and direct light" if self.settings.light is Light.TRACED else ""
        with self.status.during_cycles(f"First hits{lit_by} {{}}", share=CYCLES_SHARE):
            return cycles_session.render_passes(self.engine, self.depsgraph, samples=samples, look=look,
                                                light=self.settings.light, hazy=bool(scene.volumes),
                                                threads=self.settings.threads, report=self.report)

    def guides(self, found: dict[str, np.ndarray], scene: RenderScene, view: View) -> Guides:
        """What the network is told of a view, of whose first hits `found` are the passes."""
        with progress.part(0.0, 0.5):
            guides = make_guides(found, scene, view)
        if not self.settings.guided:
            return guides
        with progress.part(0.5, 1.0):
            return with_ends(guides, scene, view)

    def catch(self) -> Catch | None:
        """What shadow catchers show, if there are any."""
        if not self.optics.catchers:
            return None
        look, found = self.optics.look(), []
        catching = look._replace(catchers=Catchers.CATCH, opaque=not self.settings.film_transparent)
        for light, asked in ((Light.NONE, look._replace(catchers=Catchers.CUT)), (Light.TRACED, catching)):
            with self.status.during_cycles("Shadow catchers {}", share=CYCLES_SHARE):
                found.append(cycles_session.render_passes(
                    self.engine, self.depsgraph, samples=self.settings.guide_samples * self.optics.samples, light=light,
                    look=asked, threads=self.settings.threads, report=self.report))
        without, caught = found
        return Catch(caught["combined"], without["alpha"][..., 0])

    def opacity(self, view: View) -> np.ndarray | None:
        """(H, W) alpha of an opaque film, in which holdouts cut holes; None of a transparent one."""
        if self.settings.film_transparent:
            return None
        if not self.optics.holes:
            return np.ones((view.height, view.width), np.float32)
        with self.status.during_cycles("Alpha {}", share=CYCLES_SHARE):
            found = cycles_session.render_passes(
                self.engine, self.depsgraph, samples=self.settings.guide_samples * self.optics.samples,
                light=Light.NONE, look=self.optics.look()._replace(opaque=True), threads=self.settings.threads,
                report=self.report)
        return found["alpha"][..., 0]

    def encoded(self, renderer, scene: RenderScene, view: View):
        """The scene after stage 1, for this view and others of the same size."""
        with self.status.stage("Network", "scene", 1 / self.optics.shutter):
            return model_cache.encoded(renderer, scene, view.longer_side)

    def lobes(self, encoded, view: View, guides: Guides, normal: np.ndarray) -> Lobes:
        """The network's light of one view; `normal` is the pass of its first hits."""
        with self.status.stage("Network", "view", 1 / self.optics.samples):
            with progress.part(0.0, 0.9):
                guided = self.settings.guided
                lobes = encoded.lobes(view, guides, self.lit) if guided else Lobes(encoded.view(view, guides))
            if guided:
                with progress.part(0.9, 1.0, "Blending edges"):
                    lobes = blended(lobes, guides, normal)
        return lobes

    def antialiased(self, encoded, lobes: Lobes, guides: Guides,
                    combined: np.ndarray) -> tuple[Lobes, Guides, np.ndarray]:
        """A view's light, what it sees shine, and the picture `combined` (H, W, 4) of both, with smooth edges."""
        found = {"combined": combined, "radiance": lobes.radiance} | {key: getattr(guides, key) for key in SHINING}
        with self.status.stage("Network", "edges"):
            found = encoded.antialiased(found, lobes, guides, self.settings.guide_samples)
        shining = {key: found[key] for key in SHINING}
        return lobes.scaled_to(found["radiance"]), replace(guides, **shining), found["combined"]

    def blurred(self, renderer, scene: RenderScene, whole: Guides, show: Callable[[Lobes], None]) -> tuple[Lobes, int]:
        """The network's light as the mean of the samples of the optics, and the tokens of the last scene.

        Nothing is computed twice: without a change in the scene but for the camera it stays encoded, and where nothing
        changes at all the sample before counts again. `whole` are the guides of the blurred picture, as Cycles gives
        them; what there is so far is given to `show`, for every session of Cycles puts something else on screen.
        """
        optics, status, mean, encoded = self.optics, self.status, MeanLobes(), None
        points = Lens.of(self.depsgraph).points(optics.lens) if optics.lens > 1 else None
        with shutter.clock(self.engine, self.depsgraph) as move_to:
            for number, frame in enumerate(optics.frames(self.depsgraph)):
                status.sample = f"Sample {number + 1} of {optics.samples}"
                progress.report()
                moved = move_to(frame)
                if "scene" in moved:
                    with status.stage("Converting the scene", share=1 / optics.scenes):
                        scene, encoded = self.scene(), None
                if number == 0 or moved or points is not None:
                    point = points[number] if points is not None else None
                    view, guides, normal = self._seen_from(point, scene)
                    encoded = encoded or self.encoded(renderer, scene, view)
                    lobes = self.lobes(encoded, view, guides, normal)
                mean.add(lobes, guides)
                show(mean.under(whole))
        status.sample = ""
        return mean.under(whole), encoded.tokens

    def _seen_from(self, point: np.ndarray | None, scene: RenderScene) -> tuple[View, Guides, np.ndarray]:
        """A view from a point of the lens, its guides, and the normals of its first hits."""
        view, look = self.view(), PINHOLE
        if point is not None:
            lens = Lens.of(self.depsgraph)
            view, look = lens.view(view, point), Look(place=functools.partial(lens.look_from, point))
        with self.status.stage("First hits", share=1 / (2 * self.optics.samples)):
            found = self.first_hits(scene, look, self.settings.guide_samples)
            with progress.part(CYCLES_SHARE, 1.0):
                return view, self.guides(found, scene, view), found["normal"]
