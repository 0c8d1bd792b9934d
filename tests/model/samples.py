# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes without Blender: a floor of triangles under one light, seen from above, and others made of it."""
from dataclasses import replace

import numpy as np

from renderformer_v2.model.camera import view_rays
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.estimate import SceneLight
from renderformer_v2.model.scene import Guides, RenderScene, View, constant_tile


def floor_scene(side: int = 8, radiance: float = 40.0) -> RenderScene:
    """(2 side^2 + 1) triangles of one material: the square [-1, 1]^2 at z = 0 and a lamp at z = 2."""
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(-1, 1, side, endpoint=False)] * 2))
    corner, step = np.stack([x, y, 0 * x], -1)[:, None], 2 / side
    lower = corner + np.array([(0, 0, 0), (step, 0, 0), (0, step, 0)])
    upper = corner + np.array([(step, step, 0), (0, step, 0), (step, 0, 0)])
    lamp = np.array([[(-0.1, -0.1, 2), (0, 0.1, 2), (0.1, -0.1, 2)]])
    triangles = np.concatenate([lower, upper, lamp]).astype(np.float32)
    n = len(triangles)
    emission = np.zeros((n, 3), np.float32)
    emission[-1] = radiance
    normals = np.tile(np.float32((0, 0, 1)), (n, 3, 1))
    tile = constant_tile((0.8, 0.5, 0.2), roughness=0.6, ior=1.3)[None]
    return RenderScene(triangles, normals, emission, np.zeros((n, 3), np.float32), np.zeros((n, 2), np.float32),
                       np.zeros(n, np.int32), tile)


def with_black_lamps(scene: RenderScene) -> RenderScene:
    """The scene, whose lamps reflect nothing."""
    tiles = np.concatenate([scene.tiles, constant_tile((0, 0, 0))[None]])
    return replace(scene, tiles=tiles, tile_index=np.where(scene.is_light, len(scene.tiles), scene.tile_index))


def floor_view(width: int = 64, height: int = 64) -> tuple[View, Guides]:
    """A camera three units above the floor, and what it sees: inside the square the floor, outside nothing."""
    camera = np.eye(4, dtype=np.float32)
    camera[2, 3] = 3.0
    focal = np.float32((max(width, height),) * 2)
    view = View(camera, focal, np.float32((width / 2, height / 2)), width, height)
    origin, rays = view_rays(view)
    position = origin - rays * (origin[2] / rays[..., 2:])
    hit = (np.abs(position[..., :2]) < 1).all(-1)
    color = np.float32((0.8, 0.5, 0.2)) * hit[..., None]
    zero = np.zeros_like(position)
    guides = Guides(
        position=position * hit[..., None], normal=np.float32((0, 0, 1)) * hit[..., None], diffuse_color=color,
        glossy_color=zero + 0.04 * hit[..., None], transmission_color=zero, emission=zero, environment=zero,
        depth=np.where(hit, 3.0, 1e10).astype(np.float32), alpha=hit.astype(np.float32),
        hit_triangle=np.where(hit, 0, -1).astype(np.int32), hit_barycentric=np.full(hit.shape + (2,), 0.3, np.float32))
    return view, guides


def flat(corners: np.ndarray, color) -> RenderScene:
    """Triangles (n, 3, 3) of one colour, without vertex normals."""
    n = len(corners)
    rows = np.zeros((n, 3), np.float32)
    return RenderScene(corners, np.zeros((n, 3, 3), np.float32), rows, rows, np.zeros((n, 2), np.float32),
                       np.zeros(n, np.int32), constant_tile(color)[None])


def walls(color) -> RenderScene:
    """The floor, grey, and a coloured wall on its left side."""
    scene = floor_scene(side=6)
    scene.tiles[:, :3] = 0.5
    floor = scene.triangles[~scene.is_light]
    wall = np.stack([np.full_like(floor[..., 0], -1), floor[..., 1], floor[..., 0] + 1], axis=-1)[:, ::-1]
    return scene.appended(flat(wall.copy(), color))


def closed_box(color) -> RenderScene:
    """Two units wide, with a lamp in its middle."""
    square = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
    sides = [np.roll(square + np.float32((0, 0, z)), axis, axis=-1) for axis in range(3) for z in (-1, 1)]
    scene = with_black_lamps(floor_scene())
    lamp = scene.triangles[scene.is_light]
    scene.triangles[scene.is_light] = lamp - lamp.mean(axis=(0, 1)) + np.float32((0.3, 0.2, 0.1))
    lights = {name: getattr(scene, name)[scene.is_light] for name in
              ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")}
    return flat(np.concatenate(sides), color).appended(replace(scene, **lights))


def scene_light(scene: RenderScene) -> SceneLight:
    """Of a scene in network units."""
    direct = DirectLight(scene)
    return SceneLight(scene, direct, Radiosity(scene, direct))
