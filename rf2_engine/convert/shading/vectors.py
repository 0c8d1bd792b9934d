# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectors: Vector Math, Mapping, Vector Rotate, Vector Transform, Normal."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divide_safely, dot, join, length, unit
from .maths import MATHS
from .node_call import NodeCall


def _refract(a, b, ior):
    normal = unit(b)
    along = dot(normal, a)
    cosine_squared = 1 - ior * ior * (1 - along * along)
    return np.where(cosine_squared < 0, 0, ior * a - (ior * along + np.sqrt(np.maximum(cosine_squared, 0))) * normal)


VECTOR_MATHS = {
    "CROSS_PRODUCT": lambda a, b, c: np.cross(a, b), "DOT_PRODUCT": lambda a, b, c: dot(a, b),
    "LENGTH": lambda a, b, c: length(a), "DISTANCE": lambda a, b, c: length(a - b),
    "NORMALIZE": lambda a, b, c: unit(a), "FRACTION": MATHS["FRACT"],
    "PROJECT": lambda a, b, c: divide_safely(dot(a, b), dot(b, b)) * b,
    "REFLECT": lambda a, b, c: a - 2 * dot(a, unit(b)) * unit(b),
    "FACEFORWARD": lambda a, b, c: np.where(dot(c, b) < 0, a, -a),
}  # the others are the operations of Math, per component


def vector_math(n: NodeCall):
    operation = n.node.operation
    a, b, c = n[0], n[1], n[2]
    if operation == "SCALE":
        return a * n["Scale"]
    if operation == "REFRACT":
        return _refract(a, b, n[3])
    return (VECTOR_MATHS.get(operation) or MATHS[operation])(a, b, c)


def rotate(vector, angles) -> np.ndarray:
    """Vectors (..., 3) turned by XYZ Euler angles (..., 3) in radians."""
    x, y, z = np.split(vector, 3, axis=-1)
    (cx, cy, cz), (sx, sy, sz) = (np.split(f(angles), 3, axis=-1) for f in (np.cos, np.sin))
    y, z = cx * y - sx * z, sx * y + cx * z
    x, z = cy * x + sy * z, cy * z - sy * x
    return join(cz * x - sz * y, sz * x + cz * y, z)


def rotate_back(vector, angles) -> np.ndarray:
    """The inverse of `rotate`."""
    for axis in (2, 1, 0):
        vector = rotate(vector, -angles * (np.arange(3) == axis))
    return vector


def mapping(n: NodeCall):
    kind = n.node.vector_type
    vector, location, rotation, scale = (n.get(name) for name in ("Vector", "Location", "Rotation", "Scale"))
    if kind == "TEXTURE":
        return divide_safely(rotate_back(vector - location, rotation), scale)
    if kind == "NORMAL":
        return unit(rotate(divide_safely(vector, scale), rotation))
    moved = rotate(vector * scale, rotation)
    return moved + location if kind == "POINT" else moved


AXES = {"X_AXIS": (1, 0, 0), "Y_AXIS": (0, 1, 0), "Z_AXIS": (0, 0, 1)}


def vector_rotate(n: NodeCall):
    node, center = n.node, n["Center"]
    offset = n["Vector"] - center
    if node.rotation_type == "EULER_XYZ":
        return center + (rotate_back if node.invert else rotate)(offset, n["Rotation"])
    axis = unit(n["Axis"]) if node.rotation_type == "AXIS_ANGLE" else np.float32(AXES[node.rotation_type])
    angle = -n["Angle"] if node.invert else n["Angle"]
    across = np.cross(*np.broadcast_arrays(axis, offset))
    rotated = offset * np.cos(angle) + across * np.sin(angle) + axis * dot(axis, offset) * (1 - np.cos(angle))
    return center + np.where(length(axis) > 0, rotated, offset)


def vector_transform(n: NodeCall):
    node, vector = n.node, n["Vector"]
    spaces = node.convert_from, node.convert_to
    if "CAMERA" in spaces and spaces[0] != spaces[1]:
        n.approximated("camera space is treated as world space")
    spaces = tuple(space.replace("CAMERA", "WORLD") for space in spaces)
    if spaces[0] != spaces[1] and n.points.corners is not None:
        matrix = n.instance().matrix
        matrix = matrix if spaces[0] == "OBJECT" else np.linalg.inv(matrix)
        linear = np.linalg.inv(matrix[:3, :3]).T if node.vector_type == "NORMAL" else matrix[:3, :3]
        vector = vector @ np.float32(linear.T)
        if node.vector_type == "POINT":
            vector = vector + np.float32(matrix[:3, 3])
    return unit(vector) if node.vector_type == "NORMAL" else vector


def normal(n: NodeCall):
    direction = unit(np.array(n.node.outputs["Normal"].default_value, np.float32))
    return direction if n.output.name == "Normal" else dot(direction, unit(n["Normal"]))


FUNCTIONS = {
    "ShaderNodeVectorMath": vector_math, "ShaderNodeMapping": mapping, "ShaderNodeVectorRotate": vector_rotate,
    "ShaderNodeVectorTransform": vector_transform, "ShaderNodeNormal": normal,
}
