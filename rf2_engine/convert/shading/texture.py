# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture nodes: coordinates, Mapping, Image and Environment Texture, Checker and Gradient; normal maps."""
from __future__ import annotations

import numpy as np

from . import graph
from .image import sample

UP = np.array([0.0, 0.0, 1.0], np.float32)
WORLD_COORDINATES = ("Generated", "Object", "Normal", "Reflection", "UV")


def coordinate(evaluator, node, output, frames):
    points = evaluator.points
    if points.direction is not None:
        if output.name not in WORLD_COORDINATES:
            evaluator.approximated(node, f'coordinate "{output.name}" is evaluated as Generated')
        return points.direction
    if output.name != "UV":
        evaluator.approximated(node, f'coordinate "{output.name}" is not known per texel, the active UV map is used')
    return active_uv(evaluator, node)


def uv_map(evaluator, node, output, frames):
    return active_uv(evaluator, node, node.uv_map)


def active_uv(evaluator, node, name: str = "") -> np.ndarray:
    """UV of the layer `name` (the active one when empty); Cycles reads (0, 0) where a mesh has no such layer."""
    layer = evaluator.points.uv.get(name or evaluator.points.active_uv)
    if layer is None:
        which = f'UV map "{name}"' if name else "UV map"
        evaluator.approximated(node, f"the mesh has no {which}, so the whole texture shrinks to one texel; unwrap it")
        return np.zeros(3, np.float32)
    return layer


def rotation_matrix(euler: np.ndarray) -> np.ndarray:
    """(3, 3) of an XYZ Euler rotation in radians: Rz Ry Rx."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(euler), np.sin(euler)
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return (z @ y @ x).astype(np.float32)


def mapping(evaluator, node, output, frames):
    vector, location, rotation, scale = (
        evaluator.named(node, frames, name, default=0.0) for name in ("Vector", "Location", "Rotation", "Scale"))
    if rotation.ndim > 1:
        evaluator.approximated(node, "a rotation that varies over the surface is averaged")
        rotation = rotation.reshape(-1, 3).mean(axis=0)
    turn = rotation_matrix(rotation)
    shrunk = np.divide(vector, scale, out=np.zeros(np.broadcast(vector, scale).shape, np.float32), where=scale != 0)
    if node.vector_type == "TEXTURE":
        moved = (vector - location) @ turn
        return np.divide(moved, scale, out=np.zeros(np.broadcast(moved, scale).shape, np.float32), where=scale != 0)
    if node.vector_type == "NORMAL":
        normal = shrunk @ turn.T
        return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    rotated = (vector * scale) @ turn.T
    return rotated + location if node.vector_type == "POINT" else rotated


def image_texture(evaluator, node, output, frames):
    uv = evaluator.value(node.inputs[0], frames) if evaluator.is_linked(node, "Vector") else None
    if uv is None:
        on_surface = evaluator.points.direction is None
        uv = active_uv(evaluator, node) if on_surface else evaluator.points.direction
    if node.projection != "FLAT":
        evaluator.approximated(node, f"{node.projection.title()} projection is evaluated as Flat on the UV map")
    pyramid = evaluator.images.pyramid(node.image, evaluator.owner, not _alpha_used(node))
    found = _prefiltered(pyramid, uv, node.extension, node.interpolation == "Closest")
    return found[..., 3:] if output.name == "Alpha" else found[..., :3]


def _alpha_used(node) -> bool:
    """Cycles hands out straight colours only when the alpha output is used as well."""
    return node.outputs["Alpha"].is_linked


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


def environment_texture(evaluator, node, output, frames):
    """Latitude-longitude or mirror-ball lookup of a direction (spec/scene-input.md 7.1)."""
    linked = evaluator.is_linked(node, "Vector")
    direction = evaluator.value(node.inputs[0], frames) if linked else evaluator.points.direction
    if direction is None:
        evaluator.approximated(node, "an environment texture on a surface needs directions, its average is used")
        direction = UP
        level = 16
    else:
        level = 0
    pixels = evaluator.images.pyramid(node.image, evaluator.owner, True).level(level)
    x, y, z = np.moveaxis(direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12), -1, 0)
    if node.projection == "MIRROR_BALL":
        length = np.sqrt(np.maximum(x * x + (y - 1) ** 2 + z * z, 1e-12))
        uv = np.stack([0.5 * (x / length + 1), 0.5 * (z / length + 1)], axis=-1)
        return sample(pixels, uv, "EXTEND")[..., :3]
    uv = np.stack([0.5 - np.arctan2(y, x) / (2 * np.pi), 0.5 + np.arcsin(np.clip(z, -1, 1)) / np.pi], axis=-1)
    half_texel = 0.5 / pixels.shape[0]
    uv[..., 1] = np.clip(uv[..., 1], half_texel, 1 - half_texel)
    return sample(pixels, uv, "REPEAT")[..., :3]


def checker(evaluator, node, output, frames):
    cell = np.floor(_vector_or_uv(evaluator, node, frames) * evaluator.named(node, frames, "Scale") * 0.999999 + 1e-6)
    first = (cell.sum(axis=-1, keepdims=True) % 2 == 1).astype(np.float32)
    if output.name == "Fac":
        return first
    a, b = (evaluator.named(node, frames, name) for name in ("Color1", "Color2"))
    return a * first + b * (1 - first)


def gradient(evaluator, node, output, frames):
    x, y, z = np.split(_vector_or_uv(evaluator, node, frames), 3, axis=-1)
    ball = np.maximum(1 - np.sqrt(x * x + y * y + z * z), 0)
    t = np.clip(x, 0, 1)
    values = {"LINEAR": x, "QUADRATIC": np.maximum(x, 0) ** 2, "EASING": t * t * (3 - 2 * t), "DIAGONAL": (x + y) / 2,
              "RADIAL": np.arctan2(y, x) / (2 * np.pi) + 0.5, "SPHERICAL": ball, "QUADRATIC_SPHERE": ball * ball}
    return np.clip(values[node.gradient_type], 0, 1)


def _vector_or_uv(evaluator, node, frames):
    if evaluator.is_linked(node, "Vector"):
        return evaluator.value(node.inputs["Vector"], frames)
    if evaluator.points.direction is not None:
        return evaluator.points.direction
    evaluator.approximated(node, "generated coordinates are not known per texel, the active UV map is used")
    return active_uv(evaluator, node)


def tangent_normal(evaluator, socket, frames) -> np.ndarray:
    """(..., 3) tangent-space normal, 2 * map - 1, of a shader's Normal input (spec/scene-input.md 4.4)."""
    socket, output, frames = graph.source(socket, frames)
    if output is None:
        return UP
    node = output.node
    if node.bl_idname == "ShaderNodeNormalMap" and node.space == "TANGENT":
        strength = evaluator.named(node, frames, "Strength")
        mapped = 2 * evaluator.named(node, frames, "Color") - 1
        return np.clip(UP + strength * (mapped - UP), -1, 1)
    if node.bl_idname == "ShaderNodeBump":
        evaluator.approximated(node, "bump is left out; bake it to a normal map")
        return tangent_normal(evaluator, graph.find_input(node, "Normal"), frames)
    if not (node.bl_idname == "ShaderNodeNewGeometry" and output.name == "Normal"):
        evaluator.approximated(node, "only tangent-space normal maps are evaluated, the mesh normal is used")
    return UP


FUNCTIONS = {
    "ShaderNodeTexCoord": coordinate, "ShaderNodeUVMap": uv_map, "ShaderNodeMapping": mapping,
    "ShaderNodeTexImage": image_texture, "ShaderNodeTexEnvironment": environment_texture,
    "ShaderNodeTexChecker": checker, "ShaderNodeTexGradient": gradient,
}
