# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture nodes: coordinates, Mapping, Image and Environment Texture, Checker and Gradient."""
from __future__ import annotations

import numpy as np

from ....model.geometry import latlong_uv, rotation_matrix
from . import lamp
from .image import sample
from .inputs import world_position
from .node_call import NodeCall
from .normal_map import UP

WORLD_COORDINATES = ("Generated", "Object", "Normal", "Reflection", "UV")


def coordinate(n: NodeCall):
    if n.points.lamp is not None:
        return lamp.coordinate(n)
    name, direction = n.output.name, n.points.direction
    if direction is not None:
        if name not in WORLD_COORDINATES:
            n.approximated(f'coordinate "{name}" is evaluated as Generated')
        return direction if name != "Object" or n.node.object is None else _seen_from(n.node.object, direction)
    if name in ("Generated", "Object") and n.points.corners is not None:
        if name == "Generated":
            return n.points.generated
        return n.points.position if n.node.object is None else _seen_from(n.node.object, world_position(n))
    if name != "UV":
        n.approximated(f'coordinate "{name}" is not known per texel, the active UV map is used')
    return active_uv(n)


def _seen_from(obj, points: np.ndarray) -> np.ndarray:
    """World points (..., 3) in the frame of an object. Cycles takes a direction of the world for a point, too."""
    matrix = np.array(obj.matrix_world.inverted_safe(), np.float32)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def uv_map(n: NodeCall):
    return active_uv(n, n.node.uv_map)


def active_uv(n: NodeCall, name: str = "") -> np.ndarray:
    """UV of the layer `name` (the active one when empty); Cycles reads (0, 0) where a mesh has no such layer."""
    layer = n.points.uv.get(name or n.points.active_uv)
    if layer is None:
        which = f'UV map "{name}"' if name else "UV map"
        n.approximated(f"the mesh has no {which}, so the whole texture shrinks to one texel; unwrap it")
        return np.zeros(3, np.float32)
    return layer


def mapping(n: NodeCall):
    kind = n.node.vector_type
    vector, location, rotation, scale = (n.get(name) for name in ("Vector", "Location", "Rotation", "Scale"))
    if rotation.ndim > 1:
        n.approximated("a rotation that varies over the surface is averaged")
        rotation = rotation.reshape(-1, 3).mean(axis=0)
    turn = rotation_matrix(rotation).astype(np.float32)
    if kind == "TEXTURE":
        return _divided((vector - location) @ turn, scale)
    if kind == "NORMAL":
        normal = _divided(vector, scale) @ turn.T
        return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    rotated = (vector * scale) @ turn.T
    return rotated + location if kind == "POINT" else rotated


def _divided(vector, scale):
    return np.divide(vector, scale, out=np.zeros(np.broadcast(vector, scale).shape, np.float32), where=scale != 0)


def image_texture(n: NodeCall):
    node, uv = n.node, n.linked("Vector")
    if uv is None:
        uv = active_uv(n) if n.points.direction is None else n.points.direction
    if node.projection != "FLAT":
        n.approximated(f"{node.projection.title()} projection is evaluated as Flat on the UV map")
    straight = node.outputs["Alpha"].is_linked  # Cycles hands out straight colours only when alpha is used as well
    pyramid = n.images.pyramid(node.image, n.evaluator.owner, premultiply=not straight)
    found = _prefiltered(pyramid, uv, node.extension, node.interpolation == "Closest")
    return found[..., 3:] if n.output.name == "Alpha" else found[..., :3]


def _prefiltered(pyramid, uv, extension, closest):
    """Each triangle (first axis of a (m, 32, 32, 3) uv) reads the level whose texels match its own grid step."""
    if uv.ndim != 4:
        return sample(pyramid.level(0), uv, extension, closest)
    rows, columns = pyramid.level(0).shape[:2]
    size = np.array([columns, rows], np.float32)
    steps = np.stack([uv[:, 0, 1] - uv[:, 0, 0], uv[:, 1, 0] - uv[:, 0, 0]], axis=1)[..., :2] * size
    texels = np.linalg.norm(steps, axis=-1).max(axis=1)
    level = np.clip(np.round(np.log2(np.maximum(texels, 1))), 0, 15).astype(int)
    out = np.empty(uv.shape[:3] + (4,), np.float32)
    for index in np.unique(level):
        chosen = level == index
        out[chosen] = sample(pyramid.level(index), uv[chosen], extension, closest and index == 0)
    return out


def environment_texture(n: NodeCall):
    """Latitude-longitude or mirror-ball lookup of a direction (docs/scene-input.md 7.1)."""
    direction, level = n.linked("Vector"), 0
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("an environment texture on a surface needs directions, its average is used")
        direction, level = UP, 16
    pixels = n.images.pyramid(n.node.image, n.evaluator.owner, premultiply=True).level(level)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12)
    if n.node.projection == "MIRROR_BALL":
        x, y, z = np.moveaxis(direction, -1, 0)
        length = np.sqrt(np.maximum(x * x + (y - 1) ** 2 + z * z, 1e-12))
        uv = np.stack([0.5 * (x / length + 1), 0.5 * (z / length + 1)], axis=-1)
        return sample(pixels, uv, "EXTEND")[..., :3]
    uv = latlong_uv(direction)
    half_texel = 0.5 / pixels.shape[0]
    uv[..., 1] = np.clip(uv[..., 1], half_texel, 1 - half_texel)
    return sample(pixels, uv, "REPEAT")[..., :3]


def checker(n: NodeCall):
    cell = np.floor(n.coordinates() * n["Scale"] * 0.999999 + 1e-6)
    first = (cell.sum(axis=-1, keepdims=True) % 2 == 1).astype(np.float32)
    return first if n.output.name == "Fac" else n["Color1"] * first + n["Color2"] * (1 - first)


def gradient(n: NodeCall):
    x, y, z = np.split(n.coordinates(), 3, axis=-1)
    ball = np.maximum(1 - np.sqrt(x * x + y * y + z * z), 0)
    t = np.clip(x, 0, 1)
    values = {"LINEAR": x, "QUADRATIC": np.maximum(x, 0) ** 2, "EASING": t * t * (3 - 2 * t), "DIAGONAL": (x + y) / 2,
              "RADIAL": np.arctan2(y, x) / (2 * np.pi) + 0.5, "SPHERICAL": ball, "QUADRATIC_SPHERE": ball * ball}
    return np.clip(values[n.node.gradient_type], 0, 1)


FUNCTIONS = {
    "ShaderNodeTexCoord": coordinate, "ShaderNodeUVMap": uv_map, "ShaderNodeMapping": mapping,
    "ShaderNodeTexImage": image_texture, "ShaderNodeTexEnvironment": environment_texture,
    "ShaderNodeTexChecker": checker, "ShaderNodeTexGradient": gradient,
}
