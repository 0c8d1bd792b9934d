# SPDX-License-Identifier: GPL-3.0-or-later
"""Input nodes: constants, light paths, Fresnel, attributes, properties of objects, instances and particles."""
from __future__ import annotations

import numpy as np

from ....model.material import reflectance
from ....model.surface_kinds import Ray
from ..data.arrays import join
from .node_call import NodeCall
from .noise.hashing import LARGEST, jenkins

BOUNCED = "Ray Depth", "Ray Length"  # one bounce away from the camera
SINES2 = (np.arange(64) + 0.5) / 64  # squared sines of directions that are spread as light on a matte surface
CURVES_INFO, POINT_INFO, GEOMETRY = "Curves Info ", "Point Info ", "Geometry "
# Nodes whose outputs are attributes, if a mesh has them: they are called by this and the output.
INFO = {"ShaderNodeHairInfo": CURVES_INFO, "ShaderNodePointInfo": POINT_INFO, "ShaderNodeNewGeometry": GEOMETRY}
PATHS = {  # outputs of Light Path that are 1
    Ray.CAMERA: ("Is Camera Ray",),
    Ray.DIFFUSE: ("Is Diffuse Ray", "Is Reflection Ray", "Diffuse Depth", *BOUNCED),
    Ray.GLOSSY: ("Is Glossy Ray", "Is Reflection Ray", "Glossy Depth", *BOUNCED),
    Ray.TRANSMISSION: ("Is Transmission Ray", "Transmission Depth", *BOUNCED),
    Ray.SHADOW: ("Is Shadow Ray", *BOUNCED),
    Ray.SCATTER: ("Is Volume Scatter Ray", *BOUNCED),
}


def rgb(n: NodeCall):
    return np.array(n.node.outputs[0].default_value[:3], np.float32)


def value(n: NodeCall):
    return np.array([n.node.outputs[0].default_value], np.float32)


def light_path(n: NodeCall):
    n.evaluator.depends_on_ray = True
    return np.array([light_path_value(n.output.name, n.points.ray)], np.float32)


def light_path_value(output: str, ray: Ray = Ray.DIFFUSE) -> float:
    """What an output of Light Path says to such a ray."""
    return float(output in PATHS[ray])


def fresnel(n: NodeCall):
    """The mean over all directions, as light that bounces meets it: a tile knows no viewing direction."""
    n.approximated("it depends on the view: its mean over all views is used")
    if n.kind == "ShaderNodeLayerWeight":
        blend = np.clip(n["Blend"], 0, 0.999)
        if n.output.name == "Facing":
            power = np.where(blend < 0.5, 2 * blend, 0.5 / (1 - blend))  # 1 - cosine ** power
            return power / (power + 2)
        return _mean_reflectance(1 / (1 - blend))
    return _mean_reflectance(n["IOR"])


def _mean_reflectance(ior):
    """The share of light that a dielectric reflects if it arrives evenly, by the squared sine of its direction."""
    ior = np.maximum(ior, 1e-5)
    return sum(reflectance.fresnel(np.sqrt(1 - sine2), ior) for sine2 in SINES2) / len(SINES2)


def passed_through(n: NodeCall):
    """Ambient Occlusion and the like: their colour without the effect."""
    n.bake_or_report("it is ignored")
    return n.get("Color", 1.0) if n.output.name == "Color" else np.ones(1, np.float32)


def attribute(n: NodeCall):
    """UV layers, attributes and grids of volumes by name."""
    name = getattr(n.node, "attribute_name", None)
    name = n.node.layer_name if name is None else name
    points, kind = n.points, getattr(n.node, "attribute_type", "GEOMETRY")
    if kind != "GEOMETRY":
        values = property_of(n, name, kind)
    elif (grid := points.grid(name)) is not None:
        return _part(n, grid)
    else:
        name = name or points.active_color or ""
        values = points.attributes.get(name, points.uv[name][..., :2] if name in points.uv else None)
    if values is None:
        n.approximated(f'there is no attribute "{name}", so it is 0, as in Cycles')
        values = np.zeros(1, np.float32)
    return _part(n, values)


def _part(n: NodeCall, values: np.ndarray) -> np.ndarray:
    """What an output of an attribute node shows of (..., 1) to (..., 4) values."""
    channels = values.shape[-1]
    if n.output.name == "Alpha":
        return values[..., 3:] if channels == 4 else np.ones(1, np.float32)
    if n.output.type == "VALUE":
        return values[..., :1] if channels < 3 else values[..., :3].mean(axis=-1, keepdims=True)
    return join(values, 0 * values[..., :1]) if channels == 2 else values[..., :3]


def volume_info(n: NodeCall):
    grid = n.points.grid(n.output.name.lower())
    return np.zeros(1, np.float32) if grid is None else _part(n, grid)


def object_info(n: NodeCall):
    instance, name = n.instance(), n.output.name
    if name == "Material Index":
        return _values(n.evaluator.material_index)
    return _values({"Location": instance.matrix[:3, 3], "Color": instance.color[:3], "Alpha": instance.color[3],
                    "Object Index": instance.index, "Random": instance.random}[name])


def particle_info(n: NodeCall):
    particle = n.instance().particle
    if n.output.name == "Random":
        return _values(jenkins(particle.index, 0) / LARGEST)
    return _values(getattr(particle, n.output.name.lower().replace(" ", "_")))


def strand_info(n: NodeCall):
    """Curves Info and Point Info: all 0 on meshes."""
    values = n.points.attributes.get(INFO[n.kind] + n.output.name)
    if values is None:
        return np.zeros(3 if n.output.type == "VECTOR" else 1, np.float32)
    if n.output.name == "Position":
        matrix = np.float32(n.instance().matrix)
        return values @ matrix[:3, :3].T + matrix[:3, 3]
    if n.output.name in ("Thickness", "Radius"):
        return values * np.cbrt(abs(np.linalg.det(n.linear_matrix())))
    return values


def property_of(n: NodeCall, name: str, kind: str) -> np.ndarray | None:
    """(4,) a property of the object, its instancer or the view layer."""
    instance = n.instance()
    values = {"OBJECT": instance.properties, "INSTANCER": instance.instancer_properties,
              "VIEW_LAYER": instance.view_layer_properties}[kind].get(name)
    if values is None:
        return None
    return np.float32({1: (*values * 3, 1), 2: (*values, 0, 1), 3: (*values, 1)}.get(len(values), values))


def _values(of) -> np.ndarray:
    return np.atleast_1d(np.float32(of))


FUNCTIONS = {
    "ShaderNodeRGB": rgb, "ShaderNodeValue": value, "ShaderNodeLightPath": light_path, "ShaderNodeFresnel": fresnel,
    "ShaderNodeLayerWeight": fresnel, "ShaderNodeAmbientOcclusion": passed_through,
    "ShaderNodeAttribute": attribute, "ShaderNodeVertexColor": attribute, "ShaderNodeVolumeInfo": volume_info,
    "ShaderNodeObjectInfo": object_info, "ShaderNodeParticleInfo": particle_info,
    "ShaderNodeHairInfo": strand_info, "ShaderNodePointInfo": strand_info,
}
