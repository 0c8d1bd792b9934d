# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of the light tokens and the environment token, in closed form (docs/architecture.md, form_factors.py).

The lobes are unshadowed; `arriving` gives the share of diffuse light that reaches a surface, found by rays.
"""
from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.threads import shared
from ...geometry import area_vectors
from ...progress import part
from ...scene import RenderScene
from ..fresnel import gain
from ..media.in_scattering import InScattering
from ..media.transmittance import fog_of
from ..occluders import is_solid, passes_light
from ..sampling import R2, disk_points, scattered, triangle_weights
from ..visibility import Visibility
from .emitters import DISTANT, gather_emitters
from .environment_light import EnvironmentPrior
from .form_factors import beam, cosines, ggx_lobe, of_spheres, of_triangles, sphere_form_factor
from .sky_visibility import ABOVE, SkyVisibility

FOGLESS = 3.0   # network units from the centre: nobody looks for fog beyond
BEFORE = 4e-3   # network units before a lamp's middle, where the way to it ends
SKY_RAYS = 48   # from a point
AROUND = 6      # from each side of a point in the air
CHUNK = 8192    # pixels at a time: bounds memory with many lights, and the time between two polls


class Lamps(NamedTuple):
    """L emitters within the scene, in network units."""

    place: np.ndarray  # (L, 3) f32
    share: np.ndarray  # (L,) f32, of the light of all


class LightPrior:
    """Light arriving at surface points from everything that shines, unshadowed or as far as it arrives.

    Built from a RenderScene in network units (in any exposure; the result is in the same radiance units).
    """

    def __init__(self, scene: RenderScene, device: torch.device | str = "cpu"):
        e = gather_emitters(scene)
        as_tensor = lambda x: torch.as_tensor(x, dtype=torch.float32, device=device)  # noqa: E731
        self.corners, self.centers, self.radii = as_tensor(e.corners), as_tensor(e.centers), as_tensor(e.radii)
        self.origins = torch.cat([self.corners.mean(1), self.centers])
        self.distant = self.origins.norm(dim=-1) > DISTANT
        self.radiance, self.beam_axis, self.beam_cosine = map(as_tensor, (e.radiance, e.beam_axis, e.beam_cosine))
        self.environment = None if scene.environment is None else EnvironmentPrior(as_tensor(scene.environment))
        self.fog = fog_of(scene.volumes, device)
        blocking = is_solid(scene) & ~passes_light(scene, straight=True)
        with part(0.0, 0.5):
            self.blocking = scene.triangles[blocking & ~scene.is_light]  # a lamp does not shade itself
            self.blockers = Visibility(self.blocking)
        with part(0.5, 1.0):
            self.sky = None
            if self.environment is not None:
                shining = blocking & scene.is_light
                walls = Visibility(scene.triangles[blocking]) if shining.any() else self.blockers
                self.sky = SkyVisibility(walls, self.environment, self.fog)

    @cached_property
    def in_scattering(self) -> InScattering | None:
        """Of the scene's volumes; None where there are none."""
        return None if self.fog is None else InScattering(self)

    def lamps(self) -> Lamps:
        """The emitters that are no suns."""
        corners, radii, radiance, place, near = (x.cpu().numpy() for x in (
            self.corners, self.radii, self.radiance, self.origins, ~self.distant))
        silhouette = np.concatenate([np.linalg.norm(area_vectors(corners), axis=1), 2 * np.pi * radii**2])
        power = (silhouette * radiance.mean(axis=1))[near]
        return Lamps(place[near], power / max(power.sum(), 1e-20))

    def arriving(self, position: Tensor, normal: Tensor, start: Tensor | None = None,
                 sky_rays: int = SKY_RAYS) -> Tensor:
        """Shares of diffuse light that arrive past the scene's triangles and through its volumes.

        (P, 6), RGB of the sky and of emitters.

        position, normal (unit): (P, 3). start: (P, 2) in [0, 1), where among the rays that could be cast these are.
        """
        start = scattered(position, 2) if start is None else start
        with part(0.0, 0.5):
            sky = self.sky_share(position, normal, start, sky_rays)
        with part(0.5, 1.0):
            return torch.cat([sky, self.lamps_share(position, normal, start[:, None])], dim=1)

    def sky_share(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Tensor:
        """The first half of `arriving`, by so many rays from each point."""
        if self.sky is None:
            return torch.ones_like(position)
        return self.sky(position, normal, start, rays)

    def lamps_share(self, position: Tensor, normal: Tensor, start: Tensor, *glossy: Tensor) -> Tensor:
        """The second half of `arriving`, by rays to K points of every emitter, of which `start` (P, K, 2) tells.

        (P, 6) with the same of the light that glossy surfaces send on; glossy: `outgoing`, `roughness` and `at_normal`
        as below.
        """
        given = position, normal, start, *glossy
        return torch.cat(shared(self._unshaded, *(x.split(CHUNK) for x in given)))

    def _unshaded(self, x: Tensor, n: Tensor, start: Tensor, *glossy: Tensor) -> Tensor:
        """(P, 3) share of the emitters' diffuse light that arrives, (P, 6) with that of glossy light."""
        direction, sine2, share = self._beams(x)
        cosine = cosines(direction, n)
        lobes = [sphere_form_factor(cosine, sine2) * share]
        if glossy:
            lobes.append(ggx_lobe(direction, cosine, sine2, n, *glossy) * share)
        seen = sum(self._seen(x + ABOVE * n, lobes[0] > 0, direction, way) for way in start.unbind(1)) / start.shape[1]
        return torch.cat([((light * seen) @ self.radiance) / (light @ self.radiance).clamp_min(1e-12)
                          for light in lobes], 1)

    def _seen(self, x: Tensor, shines: Tensor, direction: Tensor, start: Tensor) -> Tensor:
        """(P, L) share of the light of emitters that arrives at points (P, 3), of those that shine there.

        shines: (P, L) bool; direction: (3, P, L), to them; start: (P, 2).
        """
        point, emitter = shines.nonzero().unbind(1)
        origin, near = x[point], ~self.distant[emitter, None]
        way = self._somewhere_on(emitter, direction[:, point, emitter].T, start[point]) - origin * near
        far = way.norm(dim=-1)
        blocked = self.blockers.blocked(origin, way / far.clamp_min(1e-9)[:, None], far - BEFORE)
        seen = torch.zeros_like(direction[0]).index_put((point, emitter), 1.0 * ~blocked)
        return seen if self.fog is None else seen * self.fog.passing(x[:, None], self.origins.renorm(2, 0, FOGLESS))

    def _somewhere_on(self, emitter: Tensor, towards: Tensor, start: Tensor) -> Tensor:
        """(R, 3) points of emitters (R,), of spheres on the disk that faces unit vectors (R, 3); start (R, 2)."""
        u, v = ((start[:, i] + emitter * step) % 1 for i, step in enumerate(R2))
        flat = len(self.corners)
        disk = disk_points(towards, u, v) * F.pad(self.radii, (flat, 0))[emitter, None]
        if not flat:
            return self.origins[emitter] + disk
        on_sheet = (self.corners[emitter.clamp(max=flat - 1)] * triangle_weights(u, v)[..., None]).sum(1)
        return torch.where((emitter < flat)[:, None], on_sheet, self.origins[emitter] + disk)

    def sky_around(self, position: Tensor) -> Tensor:
        """(P, 3) mean radiance from all directions that arrives from the sky in the air at points (P, 3)."""
        if self.sky is None:
            return torch.zeros_like(position)
        start, axes = scattered(position, 2), torch.eye(3, device=position.device)
        ways = (n.expand_as(position) for n in torch.cat([axes, -axes]))
        light = sum(self.environment.irradiance(n) * self.sky(position, n, start, AROUND) for n in ways)
        return light / (6 * math.pi)  # irradiances from six sides are 1.5 times the light of the sphere

    def lamps_around(self, position: Tensor) -> Tensor:
        """The same of the emitters."""
        given = position, scattered(position, 2)
        return torch.cat(shared(self._around, *(x.split(CHUNK) for x in given)))

    def _around(self, x: Tensor, start: Tensor) -> Tensor:
        direction, sine2, share = self._beams(x)
        return (sine2 / 4 * share * self._seen(x, share > 0, direction, start)) @ self.radiance

    def diffuse(self, position: Tensor, normal: Tensor, arriving: Tensor | None = None, *layer: Tensor) -> Tensor:
        """(P, 3) radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3).

        arriving: (P, 6) as above; found here without it.
        With reflectance at normal incidence and perceptual roughness of a `layer`, (P,) both, it is (P, 6): also what
        of the light that layer would send on if all came from everywhere, so that its mean share could be used.
        """
        with part(0.0, 0.5):
            arriving = self.arriving(position, normal) if arriving is None else arriving
        with part(0.5, 1.0):
            return torch.cat(shared(self._diffuse, *(x.split(CHUNK) for x in (position, normal, arriving, *layer))))

    def _diffuse(self, x: Tensor, n: Tensor, arriving: Tensor, *layer: Tensor) -> Tensor:
        sky, lamps = arriving.split(3, 1)
        direction, light = self._form_factors(x, n)
        found = [light @ self.radiance * lamps]
        if layer:
            at_normal, roughness = layer
            found.append((light * gain(at_normal, cosines(direction, n), roughness)) @ self.radiance * lamps)
        if self.environment is not None:
            of_sky = self.environment.irradiance(n) * sky / math.pi
            found = [light + of_sky for light in found]
        return torch.cat(found, dim=1)

    def beamed(self, position: Tensor, normal: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """Unshadowed light of the emitters as if all came from one point (P, 3), each as often as it matters.

        The way there (P, 3), or the direction of suns, and radiance (P, 3) that white diffuse surfaces at points (P, 3)
        with unit normals (P, 3) send on, on whichever side is lit. start: (P, 2) in [0, 1).
        """
        return tuple(torch.cat(parts) for parts in zip(*shared(
            self._beamed, *(x.split(CHUNK) for x in (position, normal, start))), strict=True))

    def _beamed(self, x: Tensor, n: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        direction, light = self._form_factors(x, n)
        light = light + self._form_factors(x, -n)[1]
        power = (light * self.radiance.mean(1)).cumsum(1)
        wanted = power[:, -1:] * start.sum(1, keepdim=True).frac()
        emitter = torch.searchsorted(power, wanted, right=True)[:, 0].clamp(max=light.shape[1] - 1)
        point = torch.arange(len(x), device=x.device)
        way = self._somewhere_on(emitter, direction[:, point, emitter].T, start) - x * ~self.distant[emitter, None]
        color = self.radiance[emitter] / self.radiance[emitter].mean(1, keepdim=True).clamp_min(1e-20)
        return way, color * power[:, -1:]

    def __call__(self, position: Tensor, normal: Tensor, outgoing: Tensor, roughness: Tensor, at_normal: Tensor,
                 arriving: Tensor | None = None) -> Tensor:
        """Radiance leaving a white diffuse, a white glossy and a white transmissive lobe.

        position, normal, outgoing (towards the viewer): (P, 3), unit vectors; roughness (P,), perceptual; at_normal
        (P,), reflectance at normal incidence. The normal is taken as it is: Cycles has turned it towards the viewer's
        side, and smooth ones may lean away at a silhouette.
        arriving: (P, 13), the six above, the shares of the lamps' glossy light and of the sky that a glossy lobe sees,
        RGB, and that of the sky that is seen through the surface; all of the light without it.
        Returns (P, 9): diffuse, glossy, transmitted RGB. Points whose normal is zero receive none.
        """
        arriving = torch.ones_like(roughness[:, None]).expand(-1, 13) if arriving is None else arriving
        given = position, normal, outgoing, roughness, at_normal, arriving
        return torch.cat(shared(self._leaving, *(x.split(CHUNK) for x in given)))

    def _leaving(self, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, at_normal: Tensor,
                 arriving: Tensor) -> Tensor:
        valid = (n.square().sum(-1, keepdim=True) > 0.25).float()
        sky, lamps, glossy_lamps, mirrored_sky, sky_behind = arriving.split([3, 3, 3, 3, 1], dim=1)
        diffuse, glossy = self._emitters(x, n, v, roughness, at_normal)
        diffuse, glossy = diffuse * lamps, glossy * glossy_lamps
        transmitted = torch.zeros_like(diffuse)
        if self.environment is not None:
            mirrored = 2 * (n * v).sum(-1, keepdim=True) * n - v
            diffuse = diffuse + self.environment.irradiance(n) * sky / math.pi
            glossy = glossy + self.environment.filtered(mirrored, roughness) * mirrored_sky
            transmitted = self.environment.filtered(-v, roughness) * sky_behind
        return torch.cat([diffuse, glossy, transmitted], -1) * valid

    def _emitters(self, x: Tensor, n: Tensor, *glossy: Tensor) -> tuple[Tensor, Tensor]:
        if not len(self.radiance):
            return torch.zeros_like(x), torch.zeros_like(x)
        direction, sine2, share = self._beams(x)
        cosine = cosines(direction, n)
        diffuse = sphere_form_factor(cosine, sine2) * share
        lobe = ggx_lobe(direction, cosine, sine2, n, *glossy) * share
        return diffuse @ self.radiance, lobe @ self.radiance

    def _form_factors(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """Unit direction (3, P, L) to every emitter, and how much of its radiance a diffuse surface sends on (P, L)."""
        direction, sine2, share = self._beams(x)
        return direction, sphere_form_factor(cosines(direction, n), sine2) * share

    def _beams(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Unit direction (3, P, L) to every emitter, its squared angular sine and its share of radiance (P, L)."""
        x = x.T[..., None] * ~self.distant  # light of suns is parallel
        flat = len(self.corners)
        parts = of_triangles(self.corners, x[..., :flat]), of_spheres(self.centers, self.radii, x[..., flat:])
        direction, sine2 = (torch.cat(both, -1) for both in zip(*parts, strict=True))
        return direction, sine2.clamp(0, 0.999), beam(direction, self.beam_axis, self.beam_cosine)
