# SPDX-License-Identifier: GPL-3.0-or-later
"""One random scene per seed, built as ordinary Blender data (paper, "Training Data")."""
from __future__ import annotations

import bpy
import numpy as np

from . import example_room, interiors, own_data, paper, wide
from .cameras import Setup, build_cameras
from .layers import add_layers
from .lights import build_lights
from .materials import build_material
from .media import build_volume
from .objects import build_objects
from .rooms import build_room
from .worlds import MEAN, build_world

LIGHTS = {"simple": 4, "full": 8}  # at most; few are more likely, because they cast the shadows one can see
WORLDS = {"simple": (0.25, 0.35, 0.4), "full": (0.55, 0.15, 0.3)}  # hdri, constant, none
VOLUMES = {"simple": (1.0, 0.0, 0.0), "full": (0.7, 0.18, 0.12)}   # 0, 1, 2
ATTEMPTS = 20
FOR_PUBLISHED = {"paper": paper.build, "example": example_room.build}  # with as many triangles as they are told


def build_scene(seed: tuple[int, ...], profile: str, views: int, triangles: int | None = None) -> Setup:
    """Replace everything in the open file by the scene of `seed`.

    triangles: most of the RenderScene, in place of the profile's own.
    Raises RuntimeError when no attempt gives `views` good views.
    """
    for attempt in range(ATTEMPTS):
        clear_file()
        rng = np.random.default_rng([*seed, attempt])
        if profile in FOR_PUBLISHED:
            setup = FOR_PUBLISHED[profile](rng, views, **({"triangles": triangles} if triangles else {}))
        elif profile in PROFILES:
            setup = PROFILES[profile](rng, views)
        else:
            setup = _build(rng, profile, views)
        if setup is not None:
            return setup._replace(token_budget=triangles or setup.token_budget)
    raise RuntimeError(f"seed {seed[0]}: no scene with {views} good views in {ATTEMPTS} attempts")


def clear_file() -> None:
    """Remove all data-blocks but scenes and the studio lights, which are slow to make again."""
    blocks = [b for kind in ("objects", "meshes", "curves", "cameras", "lights", "materials", "textures", "worlds")
              for b in getattr(bpy.data, kind)]
    blocks += [image for image in bpy.data.images
               if own_data.OWN in image or MEAN not in image and image.source == "GENERATED"]
    bpy.data.batch_remove(blocks)


def _build(rng: np.random.Generator, profile: str, views: int) -> Setup | None:
    room = build_room(rng)
    shared = build_material(rng, profile, "room")
    for surface in room.surfaces:
        surface.data.materials.append(shared if rng.uniform() < 0.5 else build_material(rng, profile, "room"))
    for item in build_objects(rng, room, int(rng.choice([1, 2, 3, 4], p=[0.3, 0.3, 0.25, 0.15]))):
        item.data.materials.append(build_material(rng, profile, "object"))
    bpy.context.view_layer.update()
    cameras = build_cameras(rng, room, views)
    if cameras is None:
        return None
    for i in range(int(rng.choice([0, 1, 2], p=VOLUMES[profile]))):
        build_volume(rng, room, f"volume {i}")
    _add_light(rng, profile, room)
    return Setup(cameras)


def _build_layered(rng: np.random.Generator, views: int) -> Setup | None:
    setup = _build(rng, "full", views)
    add_layers(rng)
    return setup


def _add_light(rng: np.random.Generator, profile: str, room) -> None:
    """Lights and world share the irradiance that puts a half-grey facing surface at about half of white."""
    irradiance = 3.0 * np.exp(rng.normal(0.0, 0.35))
    world = "none" if room.kind == "closed_box" else str(rng.choice(["hdri", "constant", "none"], p=WORLDS[profile]))
    share = {"hdri": rng.uniform(0.2, 0.8), "constant": rng.uniform(0.05, 0.4), "none": 0.0}[world]
    build_world(rng, world, share * irradiance / np.pi)
    counts = np.arange(1, LIGHTS[profile] + 1)
    build_lights(rng, room, int(rng.choice(counts, p=(1 / counts) / (1 / counts).sum())), (1 - share) * irradiance)


PROFILES = {"wide": wide.build, "indirect": interiors.build, "layered": _build_layered}
