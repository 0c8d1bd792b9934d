# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light: what arrives at surfaces from everything that shines, unshadowed in closed form, visibility by rays."""
from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...compute.threads import Once
from ...progress import part
from ...scene import ANY, RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, OCCLUDING, SHADING, Ray
from ..chunks import in_chunks
from ..cutouts import Cutouts
from ..hit_surfaces import LEANING
from ..media.in_scattering import InScattering
from ..media.transmittance import fog_of
from ..sampling import hashed_starts
from ..tensor_rays import TensorRays
from ..vectors import dot
from .emitter_light import EmitterLight
from .environment_light import EnvironmentLight, SkyVisibility
from .terminator import CurvedFaces

SKY_RAYS = 48   # from a point on a surface
AIR_RAYS = 6    # to each of six sides of a point in the air
CHUNK = 8192    # points at a time


class Visibility(NamedTuple):
    """Share of the irradiance at P points that arrives past occluders and through media, RGB."""

    sky: Tensor       # (P, 3)
    emitters: Tensor  # (P, 3)


class LobeVisibility(NamedTuple):
    """The same for the light that each lobe of a surface sends towards the viewer."""

    sky: Tensor              # (P, 3), diffuse lobe
    emitters: Tensor         # (P, 3), diffuse lobe
    glossy_sky: Tensor       # (P, 3)
    glossy_emitters: Tensor  # (P, 3)
    sky_behind: Tensor       # (P, 1), of the sky that is seen straight through the surface

    @classmethod
    def full(cls, points: Tensor) -> LobeVisibility:
        """Nothing is in the way of P points (P, 3)."""
        ones = torch.ones_like(points)
        return cls(ones, ones, ones, ones, ones[:, :1])


class DirectLight:
    """Light from emitters and the environment at surface points of a RenderScene in network units.

    It may be in any exposure; results are in the same radiance units. All arguments and results are on `device`.
    """

    def __init__(self, scene: RenderScene, device: torch.device | str = "cpu"):
        environment = scene.environment
        self.environment = None if environment is None else EnvironmentLight(
            torch.as_tensor(environment, dtype=torch.float32, device=device))
        skies = [(rays, self.environment if seen is environment else EnvironmentLight(
            torch.as_tensor(seen, dtype=torch.float32, device=device))) for rays, seen in scene.environments]
        self._seen_sky = {ray: next((sky for rays, sky in skies if rays & ray), None) for ray in Ray}
        self.fog = fog_of(scene, device)
        rays = scene_rays(scene)
        with part(0.0, 0.5):
            self.occluders = TensorRays(rays.among(OCCLUDING, Ray.SHADOW))
            self.cutouts = Cutouts.of(scene, Ray.SHADOW, device)
        self.emitters = EmitterLight(scene, self.fog, device, self.cutouts)
        self.device = self.emitters.radiance.device
        self._scene, self._curved, self._through_glass = scene, Once(), Once()
        with part(0.5, 1.0):
            self.sky = None
            if self.environment is not None:
                occluders = TensorRays(rays.among(SHADING, Ray.SHADOW))
                self.sky = SkyVisibility(occluders, self.environment, self.fog, self.cutouts)

    @property
    def bounces(self) -> set[int]:
        """Most bounces that the light of some emitter, or of the sky, has."""
        return self.emitters.bounces | {ANY}

    @property
    def curved(self) -> CurvedFaces | None:
        """The faces that stand for curved surfaces, searched for when they are first asked for; None without any."""
        return self._curved.get(lambda: (CurvedFaces.of(self._scene, self.device),))[0]

    @property
    def has_glass(self) -> bool:
        """Whether there is glass that light of emitters meets."""
        return len(self.emitters) > 0 and len(scene_rays(self._scene).rows(BENDING, Ray.SHADOW)) > 0

    @property
    def through_glass(self) -> DirectLight:
        """The same, of emitters whose light goes straight through glass, as gloss shows them."""
        return self._through_glass.get(self._find_through_glass)

    def _find_through_glass(self) -> DirectLight:
        light = copy.copy(self)
        light.emitters = self.emitters.through_glass(self._scene)
        return light

    def reaching(self, group: int | None = None,
                 bounces: Callable[[np.ndarray], np.ndarray] | None = None) -> DirectLight:
        """The light alone that falls on a group of surfaces, and whose most bounces (K,) are chosen, (K,) bool."""
        emitters = self.emitters.reaching(group, bounces)
        has_sky = bounces is None or bool(bounces(np.array([ANY]))[0])
        if emitters is self.emitters and has_sky:
            return self
        some = copy.copy(self)
        some.emitters, some._seen_sky = emitters, self._seen_sky if has_sky else dict.fromkeys(Ray)
        return some

    def sky_seen_by(self, ray: Ray) -> EnvironmentLight | None:
        """The environment as such rays see it, if they do."""
        return self._seen_sky[ray]

    @cached_property
    def in_scattering(self) -> InScattering | None:
        """Light that the scene's media scatter; None without media."""
        return None if self.fog is None else InScattering(self.fog, self.sky_radiance_in_air, self.emitters)

    def visibility(self, position: Tensor, normal: Tensor, start: Tensor | None = None,
                   sky_rays: int = SKY_RAYS, *curved: Tensor) -> Visibility:
        """At points (P, 3) with unit normals (P, 3), for a diffuse surface.

        start: (P, 2) in [0, 1), where in their sequence the rays of each point begin. curved: unit normals of faces and
        ways up to curved surfaces, (P, 3) each, as of EmitterLight.visibility.
        """
        start = hashed_starts(position, 2) if start is None else start
        with part(0.0, 0.5):
            sky = self.sky_visibility(position, normal, start, sky_rays)
        with part(0.5, 1.0):
            return Visibility(sky, self.emitter_visibility(
                position, normal, torch.cat([position, *curved], 1)[:, None], start[:, None])[0])

    def sky_visibility(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Tensor:
        """(P, 3) share of the sky's irradiance, by so many rays from each point; arguments as above."""
        if self.sky is None:
            return torch.ones_like(position)
        return self.sky(position, normal, start, rays)

    def emitter_visibility(self, position: Tensor, normal: Tensor, origin: Tensor, start: Tensor,
                           *gloss: Tensor) -> tuple[Tensor, ...]:
        """As EmitterLight.visibility."""
        return in_chunks(CHUNK, self.emitters.visibility, position, normal, origin, start, *gloss)

    def may_pass_glass(self, position: Tensor) -> Tensor:
        """As EmitterLight.may_pass_glass."""
        return in_chunks(CHUNK, self.emitters.may_pass_glass, position)

    def highlights(self, position: Tensor, normal: Tensor, start: Tensor, *gloss: Tensor) -> Tensor:
        """As EmitterLight.highlights."""
        if not len(self.emitters) or not len(position):
            return torch.zeros_like(position)
        return in_chunks(CHUNK, self.emitters.highlights, position, normal, start, *gloss)

    def sky_radiance_in_air(self, position: Tensor) -> Tensor:
        """(P, 3) radiance of the sky that arrives in the air at points (P, 3), as the mean over all directions."""
        environment = self.sky_seen_by(Ray.SCATTER)
        if environment is None:
            return torch.zeros_like(position)
        start, axes = hashed_starts(position, 2), torch.eye(3, device=position.device)
        sides = (n.expand_as(position) for n in torch.cat([axes, -axes]))
        light = sum(environment.irradiance(n) * self.sky(position, n, start, AIR_RAYS) for n in sides)
        return light / (6 * math.pi)  # irradiances from six sides are 1.5 times the light of the sphere

    def diffuse(self, position: Tensor, normal: Tensor, visibility: Visibility | None = None) -> Tensor:
        """(P, 3) radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3)."""
        return self.diffuse_and_layer(position, normal, visibility)[0]

    def diffuse_and_layer(self, position: Tensor, normal: Tensor, visibility: Visibility | None = None,
                          *layer: Tensor) -> tuple[Tensor, ...]:
        """The same, and with f0 and roughness (P,) of a dielectric `layer` its weighted light, and where it comes from.

        As EmitterLight.diffuse has them; the sky comes from everywhere.
        """
        with part(0.0, 0.5):
            visibility = self.visibility(position, normal) if visibility is None else visibility
        with part(0.5, 1.0):
            return in_chunks(CHUNK, self._diffuse, position, normal, *visibility, *layer)

    def _diffuse(self, x: Tensor, n: Tensor, sky: Tensor, emitters: Tensor, *layer: Tensor) -> tuple[Tensor, ...]:
        white, *of_layer = self.emitters.diffuse(x, n, *layer)
        radiance = [white * emitters, *(light * emitters for light in of_layer[:1])]
        for i, ray in enumerate((Ray.DIFFUSE, Ray.GLOSSY)[:len(radiance)]):
            if (environment := self.sky_seen_by(ray)) is not None:
                radiance[i] = radiance[i] + environment.irradiance(n) * sky / math.pi
        return *radiance, *(toward * emitters.mean(1, keepdim=True) for toward in of_layer[1:])

    def sample_emitters(self, position: Tensor, normal: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """As EmitterLight.sample."""
        return in_chunks(CHUNK, self.emitters.sample, position, normal, start)

    def strongest_emitters(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, STRONGEST, len(EMITTER)) as EmitterLight.strongest; their shares are those of emitters and sky."""
        def strongest(x: Tensor, n: Tensor) -> Tensor:
            environment = self.sky_seen_by(Ray.DIFFUSE)
            sky = torch.zeros_like(x) if environment is None else environment.irradiance(n) / math.pi
            return self.emitters.strongest(x, n, sky)

        return in_chunks(CHUNK, strongest, position, normal)

    def lobes(self, position: Tensor, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor,
              visibility: LobeVisibility | None = None, *footprint: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Radiance leaving a white diffuse, a white glossy and a white transmissive lobe, (P, 3) each.

        position, normal, outgoing (towards the viewer): (P, 3), unit vectors; roughness (P,), perceptual; f0 (P,). The
        normal is taken as it is: Cycles has turned it towards the viewer's side, and smooth ones may lean away at a
        silhouette, where up to LEANING something is mirrored. visibility: all of the light without it. footprint:
        (P, 2, 9), of pixels (footprints.py). Points whose normal is zero receive none.
        """
        if visibility is not None and len(self.emitters):
            mirrored = in_chunks(CHUNK, self.emitters.mirrored_visibility, visibility.glossy_emitters, position, normal,
                                 outgoing, roughness, *footprint)
            visibility = visibility._replace(glossy_emitters=mirrored)
        visibility = LobeVisibility.full(position) if visibility is None else visibility
        return in_chunks(CHUNK, self._lobes, position, normal, outgoing, roughness, f0, *visibility, *footprint)

    def sheen(self, position: Tensor, normal: Tensor, stretch: Tensor, lean: Tensor) -> tuple[Tensor, Tensor]:
        """As EmitterLight.sheen; stretch: (P,), lean: (P, 3)."""
        return in_chunks(CHUNK, self.emitters.sheen, position, normal, stretch, lean)

    def _lobes(self, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor,
               *rest: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        visible, footprint = LobeVisibility(*rest[:5]), rest[5:]
        has_normal = (n.square().sum(-1, keepdim=True) > 0.25).float()
        cosine = dot(n, v)[:, None]
        diffuse, glossy = self.emitters.lobes(x, n, v, roughness, f0, *footprint)
        diffuse, glossy = diffuse * visible.emitters, glossy * visible.glossy_emitters
        transmitted = torch.zeros_like(diffuse)
        if (environment := self.sky_seen_by(Ray.DIFFUSE)) is not None:
            diffuse = diffuse + environment.irradiance(n) * visible.sky / math.pi
        if (environment := self.sky_seen_by(Ray.GLOSSY)) is not None:
            shown = (visible.glossy_sky > 0).any(1).nonzero()[:, 0]
            glossy = glossy.index_add(0, shown, visible.glossy_sky[shown] * environment.reflected(
                *(values[shown] for values in (n, v, roughness, f0, *footprint))))
        if (environment := self.sky_seen_by(Ray.TRANSMISSION)) is not None:
            transmitted = environment.filtered(-v, roughness) * visible.sky_behind
        return diffuse * has_normal, glossy * has_normal * (cosine > -LEANING), transmitted * has_normal
