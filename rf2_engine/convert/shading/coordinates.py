# SPDX-License-Identifier: GPL-3.0-or-later
"""Coordinates of a point: Texture Coordinate, UV Map, Geometry."""
from __future__ import annotations

import numpy as np

from ..data.arrays import join, unit
from ..data.blocks import Frame
from . import lamp_nodes
from .input_nodes import GEOMETRY
from .node_call import DependsOnView, NodeCall, Unknown

WORLD_COORDINATES = ("Generated", "Object", "Normal", "Reflection", "UV")
PER_ISLAND = GEOMETRY + "Random Per Island"  # an attribute


def coordinate(n: NodeCall):
    if n.points.lamp is not None:
        return lamp_nodes.coordinate(n)
    name, direction, points = n.output.name, n.points.direction, n.points
    if direction is not None:
        if name not in WORLD_COORDINATES:
            n.approximated(f'coordinate "{name}" is evaluated as Generated')
        return direction if name != "Object" or n.node.object is None else _in_frame(n.node.object, direction)
    if n.node.from_instancer and name in ("Generated", "UV"):
        instance = n.instance()
        return np.float32(instance.generated) / 2 - 0.5 if name == "Generated" else np.float32((*instance.uv, 0))
    if name == "UV" or points.corners is None:
        return active_uv(n)
    if name == "Generated":
        return points.generated
    if name == "Normal":
        return points.normal
    if name == "Object":
        return points.position if n.node.object is None else _in_frame(n.node.object, world_position(n))
    raise DependsOnView(f'coordinate "{name}" depends on the view')


def _in_frame(frame: Frame, points: np.ndarray) -> np.ndarray:
    """World points (..., 3) in the frame of an object. Cycles treats a direction of the world as a point, too."""
    return points @ frame.from_world[:3, :3].T + frame.from_world[:3, 3]


def uv_map(n: NodeCall):
    return np.float32((*n.instance().uv, 0)) if n.node.from_instancer else active_uv(n, n.node.uv_map)


def active_uv(n: NodeCall, name: str = "") -> np.ndarray:
    """UV of the layer `name` (the active one when empty); Cycles reads (0, 0) where a mesh has no such layer."""
    layer = n.points.uv.get(name or n.points.active_uv)
    if layer is None:
        which = f'UV map "{name}"' if name else "UV map"
        n.approximated(f"the mesh has no {which}, so the texture becomes a single color: unwrap the mesh")
        return np.zeros(3, np.float32)
    return layer


def geometry(n: NodeCall):
    if n.points.lamp is not None:
        return lamp_nodes.coordinate(n)
    name, points = n.output.name, n.points
    if points.direction is not None and name in ("Position", "Normal", "True Normal", "Incoming"):
        return points.direction if name == "Position" else -points.direction
    if name == "Backfacing":
        n.evaluator.depends_on_side = True
        return np.array([n.points.is_behind], np.float32)
    if name == "Pointiness":
        n.bake_or_report("Pointiness is the same everywhere, as on a flat surface")
        return np.full(1, 0.5, np.float32)
    if name == "Random Per Island":
        return points.attributes.get(PER_ISLAND, np.zeros(1, np.float32))
    if name == "Incoming":
        raise DependsOnView(f'"{name}" depends on the view')
    if points.corners is None or name == "Parametric":
        raise Unknown(f'"{name}" is not known')
    if name == "Position":
        return world_position(n)
    normal = normals_in_world(n, points.face_normal if name == "True Normal" else points.normal)
    if name != "Tangent":
        return normal
    x, y, _ = np.split(points.generated - 0.5, 3, axis=-1)
    around = normals_in_world(n, join(-y, x, 0 * x))
    return np.cross(normal, unit(np.cross(around, normal)))


def camera_data(n: NodeCall):
    raise DependsOnView(f'"{n.output.name}" depends on the view')


def normals_in_world(n: NodeCall, normals: np.ndarray) -> np.ndarray:
    """Unit normals in the world's frame of normals in the object's."""
    return unit(normals @ np.float32(np.linalg.pinv(n.instance().matrix[:3, :3])))


def world_position(n: NodeCall) -> np.ndarray:
    """(m, 32, 32, 3) f32."""
    matrix = np.float32(n.instance().matrix)
    return n.points.position @ matrix[:3, :3].T + matrix[:3, 3]


FUNCTIONS = {"ShaderNodeTexCoord": coordinate, "ShaderNodeUVMap": uv_map, "ShaderNodeNewGeometry": geometry,
             "ShaderNodeCameraData": camera_data}
