# SPDX-License-Identifier: GPL-3.0-or-later
"""Input nodes: constants, light paths, Fresnel and attributes."""
from __future__ import annotations

import numpy as np

from ..data.arrays import joined
from .node_call import NodeCall
from .object_info import property_of

LIT = {"Is Diffuse Ray": 1.0, "Is Reflection Ray": 1.0, "Ray Depth": 1.0, "Diffuse Depth": 1.0, "Ray Length": 1.0}


def rgb(n: NodeCall):
    return np.array(n.node.outputs[0].default_value[:3], np.float32)


def value(n: NodeCall):
    return np.array([n.node.outputs[0].default_value], np.float32)


def light_path(n: NodeCall):
    """BSDFs answer as seen by the camera; what radiates answers as it lights the scene."""
    n.evaluator.depends_on_ray = True
    if n.points.camera_ray:
        return np.array([n.output.name == "Is Camera Ray"], np.float32)
    return np.array([LIT.get(n.output.name, 0.0)], np.float32)


def fresnel(n: NodeCall):
    """Seen at normal incidence: a tile knows no viewing direction."""
    n.approximated(f"{n.node.bl_label} depends on the view: its value for a view at right angles is used")
    if n.kind == "ShaderNodeLayerWeight":
        blend = np.clip(n["Blend"], 0, 0.999)
        return _normal_reflectance(1 / (1 - blend)) if n.output.name == "Fresnel" else np.zeros(1, np.float32)
    return _normal_reflectance(n["IOR"])


def _normal_reflectance(ior):
    return ((ior - 1) / (ior + 1)) ** 2


def passed_through(n: NodeCall):
    """Ambient Occlusion and the like: their colour without the effect."""
    n.left_to_cycles(f"{n.node.bl_label} is ignored")
    return n.get("Color", 1.0) if n.output.name == "Color" else np.ones(1, np.float32)


def attribute(n: NodeCall):
    """UV layers, attributes and grids of volumes by name."""
    name = getattr(n.node, "attribute_name", None)
    name = n.node.layer_name if name is None else name
    points, kind = n.points, getattr(n.node, "attribute_type", "GEOMETRY")
    if kind != "GEOMETRY":
        found = property_of(n, name, kind)
    elif (grid := points.grid(name)) is not None:
        return _part(n, grid)
    else:
        name = name or points.active_color or ""
        found = points.attributes.get(name, points.uv[name][..., :2] if name in points.uv else None)
    if found is None:
        n.approximated(f'there is no attribute "{name}", so it is 0, as in Cycles')
        found = np.zeros(1, np.float32)
    return _part(n, found)


def _part(n: NodeCall, found: np.ndarray) -> np.ndarray:
    """What an output of an attribute node shows of (..., 1) to (..., 4) values."""
    channels = found.shape[-1]
    if n.output.name == "Alpha":
        return found[..., 3:] if channels == 4 else np.ones(1, np.float32)
    if n.output.type == "VALUE":
        return found[..., :1] if channels < 3 else found[..., :3].mean(axis=-1, keepdims=True)
    return joined(found, 0 * found[..., :1]) if channels == 2 else found[..., :3]


def volume_info(n: NodeCall):
    grid = n.points.grid(n.output.name.lower())
    return np.zeros(1, np.float32) if grid is None else _part(n, grid)


FUNCTIONS = {
    "ShaderNodeRGB": rgb, "ShaderNodeValue": value, "ShaderNodeLightPath": light_path, "ShaderNodeFresnel": fresnel,
    "ShaderNodeLayerWeight": fresnel, "ShaderNodeAmbientOcclusion": passed_through,
    "ShaderNodeAttribute": attribute, "ShaderNodeVertexColor": attribute, "ShaderNodeVolumeInfo": volume_info,
}
