# SPDX-License-Identifier: GPL-3.0-or-later
"""Input nodes: constants, light paths, Fresnel, black bodies and attributes."""
from __future__ import annotations

import numpy as np

from . import lamp
from .node_call import NodeCall

LIT = {"Is Diffuse Ray": 1.0, "Is Reflection Ray": 1.0, "Ray Depth": 1.0, "Diffuse Depth": 1.0, "Ray Length": 1.0}
DENSITY_ATTRIBUTES = ("density", "Density")
XYZ_TO_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                          [0.0556434, -0.2040259, 1.0572252]])


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
    n.approximated(f"{n.node.bl_label} depends on the view, its value at normal incidence is used")
    if n.kind == "ShaderNodeLayerWeight":
        blend = np.clip(n["Blend"], 0, 0.999)
        return _normal_reflectance(1 / (1 - blend)) if n.output.name == "Fresnel" else np.zeros(1, np.float32)
    return _normal_reflectance(n["IOR"])


def _normal_reflectance(ior):
    return ((ior - 1) / (ior + 1)) ** 2


def geometry(n: NodeCall):
    if n.points.lamp is not None:
        return lamp.coordinate(n)
    name, direction = n.output.name, n.points.direction
    if direction is not None and name in ("Position", "Normal", "True Normal", "Incoming"):
        return direction if name == "Position" else -direction
    if name == "Position" and n.points.corners is not None:
        return world_position(n)
    if name == "Backfacing":
        n.approximated("both sides of a face get the front side's material")
        return np.zeros(1, np.float32)
    n.approximated(f'"{name}" is not known per texel, 0.5 is used')
    return np.full(1, 0.5, np.float32)


def world_position(n: NodeCall) -> np.ndarray:
    """(m, 32, 32, 3) f32; a tile can only know one instance of its mesh."""
    if n.points.instances > 1:
        n.approximated("all instances of a mesh look as the first one does at its place")
    matrix = n.points.to_world.astype(np.float32)
    return n.points.position @ matrix[:3, :3].T + matrix[:3, 3]


def passed_through(n: NodeCall):
    """Ambient Occlusion and the like: their colour without the effect."""
    n.approximated(f"{n.node.bl_label} is left out")
    return n.get("Color", 1.0) if n.output.name == "Color" else np.ones(1, np.float32)


def attribute(n: NodeCall):
    """UV layers and colour attributes by name; a volume's density grid is 1 (the grid itself multiplies later)."""
    name = getattr(n.node, "attribute_name", None)
    name = n.node.layer_name if name is None else name
    points = n.points
    if name in DENSITY_ATTRIBUTES and name not in points.colors:
        return np.ones(1, np.float32)
    name = name or points.active_color or ""
    found = points.colors.get(name, points.uv.get(name))
    if found is None:
        n.approximated(f'attribute "{name}" is not available, 0.5 is used')
        return np.full(1, 0.5, np.float32)
    if n.output.name == "Alpha":
        return found[..., 3:] if found.shape[-1] == 4 else np.ones(1, np.float32)
    return found[..., :3].mean(axis=-1, keepdims=True) if n.output.type == "VALUE" else found[..., :3]


def density(n: NodeCall):
    return np.full(1, float(n.output.name == "Density"), np.float32)


def blackbody(n: NodeCall):
    return blackbody_color(float(np.mean(n[0])))


def blackbody_color(kelvin: float) -> np.ndarray:
    """(3,) f32 scene-linear Rec.709 colour of luminance 1 of a black body, limited to Blender's 800-12000 K."""
    nm = np.arange(380.0, 781.0, 5.0)
    planck = nm ** -5.0 / np.expm1(1.4387769e7 / (nm * np.clip(kelvin, 800, 12000)))
    xyz = observer(nm) @ planck
    return np.maximum(XYZ_TO_REC709 @ (xyz / xyz[1]), 0).astype(np.float32)


def observer(nm: np.ndarray) -> np.ndarray:
    """(3, n) CIE 1931 colour matching at wavelengths in nanometres, piecewise Gaussian (Wyman, Sloan, Shirley 2013)."""
    def lobe(mean, below, above):
        return np.exp(-0.5 * ((nm - mean) / np.where(nm < mean, below, above)) ** 2)

    return np.stack([
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8)])


FUNCTIONS = {
    "ShaderNodeRGB": rgb, "ShaderNodeValue": value, "ShaderNodeLightPath": light_path, "ShaderNodeFresnel": fresnel,
    "ShaderNodeLayerWeight": fresnel, "ShaderNodeNewGeometry": geometry, "ShaderNodeAmbientOcclusion": passed_through,
    "ShaderNodeAttribute": attribute, "ShaderNodeVertexColor": attribute, "ShaderNodeVolumeInfo": density,
    "ShaderNodeBlackbody": blackbody,
}
