# SPDX-License-Identifier: GPL-3.0-or-later
"""Bring a scene into the range the network was trained on, and its radiance back (docs/scene-input.md 1.2, 6.4).

A similarity transform keeps angles, so radiance and volume coefficients (which are per box) stay as they are; light
transport is linear, so one factor on all emitters is undone by dividing the picture by it.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .beams import beam_share, smoothed
from .fields import DISPLACEMENT, LENGTH, POINT, RADIANCE, map_arrays
from .geometry import area_vectors
from .scene import Guides, RenderScene, View
from .scene_rays import share_rays

HALF_EXTENT = 0.5          # of the scene's box, in network units
CENTRAL_IRRADIANCE = 4.0   # W/m^2 that all lights and the environment together bring to the scene's centre
DARK = 1e-12               # W/m^2 that count as no light
NEAREST_LIGHT = 0.5        # network units; an emitter inside the scene must not decide the exposure alone


@dataclass(frozen=True)
class Normalization:
    """x_network = (x_world - center) * scale; radiance_network = radiance_world * exposure."""

    center: np.ndarray  # (3,) f32, world units
    scale: float
    exposure: float

    @classmethod
    def of(cls, scene: RenderScene) -> Normalization:
        center, scale = _fit(scene)
        exposure = _exposure(scene, center, scale) if scene.exposure is None else float(scene.exposure[0])
        return cls(center, scale, exposure)

    def points(self, x: np.ndarray) -> np.ndarray:
        return ((x - self.center) * np.float32(self.scale)).astype(np.float32)

    def scene(self, scene: RenderScene) -> RenderScene:
        """The same scene in network units, displacement heights included."""
        scale, exposure = np.float32(self.scale), np.float32(self.exposure)
        changes = {POINT: self.points, LENGTH: lambda x: x * scale, RADIANCE: lambda x: x * exposure,
                   DISPLACEMENT: lambda x: (x * scale).clip(-1, 1) if x.any() else x}
        normalized = map_arrays(scene, changes)
        share_rays(scene, normalized, self.center, self.scale)
        return normalized

    def view(self, view: View) -> View:
        camera = view.camera_to_world.astype(np.float32).copy()
        camera[:3, 3] = self.points(camera[:3, 3])
        return replace(view, camera_to_world=camera, clip_start=view.clip_start * self.scale)

    def guides(self, guides: Guides) -> Guides:
        """Positions in network units, radiance in network exposure."""
        hit = (guides.alpha > 0)[..., None]
        changed = {name: self.points(array) for name, array in guides.arrays().items() if name.endswith("position")}
        changed["position"] = np.where(hit, changed["position"], 0).astype(np.float32)
        light = {name: array for name, array in guides.arrays().items()
                 if name in ("traced", "noise", "emission", "environment") or name.endswith("_light")}
        changed |= {name: array * np.float32(self.exposure) for name, array in light.items()}
        return replace(guides, **changed)


def _fit(scene: RenderScene) -> tuple[np.ndarray, float]:
    low, high = scene.box if scene.box is not None else _bounds(scene)
    half = float((high - low).max()) / 2
    scale = HALF_EXTENT / half if half > 1e-9 else 1.0
    return ((low + high) / 2).astype(np.float32), scale


def _bounds(scene: RenderScene) -> tuple[np.ndarray, np.ndarray]:
    corners = scene.triangles[~scene.is_light].reshape(-1, 3)
    if scene.volumes:
        corners = np.concatenate([corners, scene.volumes.position])
    if not len(corners):
        corners = scene.triangles.reshape(-1, 3)
    if not len(corners):
        return np.full(3, -0.5, np.float32), np.full(3, 0.5, np.float32)
    return corners.min(axis=0), corners.max(axis=0)


def _exposure(scene: RenderScene, center: np.ndarray, scale: float) -> float:
    irradiance = central_irradiance(scene, center, scale).sum()
    if scene.environment is not None:
        rows = np.sin(np.pi * (np.arange(scene.environment.shape[0]) + 0.5) / scene.environment.shape[0])
        irradiance += np.pi * np.average(scene.environment.mean(axis=(1, 2)), weights=rows)
    if scene.fire is not None:
        distance = np.linalg.norm(scene.fire.position - center, axis=1).clip(NEAREST_LIGHT / scale)
        irradiance += (scene.fire.radiance.mean(axis=1) * (scene.fire.size / distance) ** 2).sum()
    return CENTRAL_IRRADIANCE / max(abs(float(irradiance)), DARK)  # what a network draws without light is divided away


def central_irradiance(scene: RenderScene, center: np.ndarray, scale: float) -> np.ndarray:
    """(L,) irradiance in W/m^2 at `center` from each of the scene's lights, lengths being in network units."""
    lights = scene.is_light
    to_center = (center - scene.triangles[lights].mean(axis=1)) * scale
    distance = np.linalg.norm(to_center, axis=1).clip(1e-9)
    # On average over directions half of the area is projected: stable when a lamp turns.
    projected = np.linalg.norm(area_vectors(scene.triangles[lights]), axis=1) * scale**2 / 2
    emission, borders = smoothed(scene.emission[lights], scene.beam_cosine[lights])
    beam = _beam(scene.beam_axis[lights], borders, to_center / distance[:, None])
    return emission.mean(axis=1) * beam * projected / distance.clip(NEAREST_LIGHT) ** 2


def _beam(axis: np.ndarray, cosine: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(L,) share of its radiance that a light emits along unit directions (L, 3); at least its front's mean."""
    share = beam_share((direction * axis).sum(axis=1), cosine)
    mean = (1 - cosine.mean(axis=1)).clip(0, 1)
    return np.where(axis.any(axis=1), np.maximum(share, mean), 1)
