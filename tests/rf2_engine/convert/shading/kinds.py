# SPDX-License-Identifier: GPL-3.0-or-later
"""Shorthands for cases of value nodes (squares.py)."""
import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.attributes import STORED

from tests.rf2_engine.convert.shading.squares import Case


def texture(name, output=0, settings=None, **inputs):
    """A texture of the square's own coordinates, and of W = x where it has one dimension."""
    settings = settings or {}
    of = {} if "1D" in settings.values() else {"Vector": "at"}
    more = {"W": "x"} if "1D" in settings.values() else {"W": 0.4} if "4D" in settings.values() else {}
    return Case("ShaderNodeTex" + name, {**of, **more, **{k.replace("_", " "): v for k, v in inputs.items()}}, settings,
                output)


def voronoi(feature, dimensions, output=0, distance=None, **inputs):
    settings = {"feature": feature, "voronoi_dimensions": dimensions}
    if distance is not None:
        settings["distance"] = distance
    normalize = inputs.pop("normalize", None)
    if normalize is not None:
        settings["normalize"] = normalize
    return texture("Voronoi", output, settings, **{"Scale": 2.3, **inputs})


def noise(dimensions, kind, output=0, normalize=True, **inputs):
    settings = {"noise_dimensions": dimensions, "noise_type": kind, "normalize": normalize}
    return texture("Noise", output, settings, **{"Scale": 2.3, **inputs})


def mix(kind, **settings):
    return Case("ShaderNodeMix", {"A": "color", "B": "other", "Factor": 0.7},
                {"data_type": "RGBA", "blend_type": kind, **settings})


def maths(operation, **settings):
    inputs = {0: "x", 1: 0.35, 2: 0.2}
    if operation in ("POWER", "LOGARITHM", "SQRT", "INVERSE_SQRT"):
        inputs[0] = "color"
    if operation in ("ARCTAN2", "SMOOTH_MIN", "SMOOTH_MAX"):
        inputs[1] = "y"
    return Case("ShaderNodeMath", inputs, {"operation": operation, **settings})


def vector_math(operation):
    inputs = {0: "at", 1: (0.35, 0.5, -0.7), 2: (0.1, -0.2, 0.3), 3: 0.7}
    if operation in ("PROJECT", "FACEFORWARD", "DOT_PRODUCT", "DISTANCE"):
        inputs[1] = "other"
    if operation == "POWER":
        inputs[0] = "color"
    return Case("ShaderNodeVectorMath", inputs, {"operation": operation})


def map_range(kind, vector, clamp):
    inputs = {0: "x", 1: -0.6, 2: 0.7, 3: 0.2, 4: 1.4, 5: 3.0} if not vector else {
        6: "at", 7: (-0.6, -0.4, -0.5), 8: (0.7, 0.5, 0.4), 9: (0.2, 0.3, 0.1), 10: (1.4, 0.7, 0.9), 11: (3, 4, 2)}
    return Case("ShaderNodeMapRange", inputs, {
        "interpolation_type": kind, "clamp": clamp, "data_type": "FLOAT_VECTOR" if vector else "FLOAT"})


def of_color(kind, output=0, settings=None, **inputs):
    return Case("ShaderNode" + kind, {"Color": "color", **{k.replace("_", " "): v for k, v in inputs.items()}},
                settings or {}, output)


def rotate(kind, **settings):
    inputs = {"Vector": "at", "Center": (0.2, 0.1, 0.3)}
    inputs |= {"Rotation": (0.4, 0.9, -0.3)} if kind == "EULER_XYZ" else {"Angle": 0.8}
    if kind == "AXIS_ANGLE":
        inputs["Axis"] = (0.3, 0.5, 0.9)
    return Case("ShaderNodeVectorRotate", inputs, {"rotation_type": kind, **settings})


def transform(kind, source, target):
    return Case("ShaderNodeVectorTransform", {"Vector": "at"},
                {"vector_type": kind, "convert_from": source, "convert_to": target})


def attribute(domain, kind, output):
    """An attribute of the mesh with other values everywhere."""
    def furnish(square):
        made = square.data.attributes.new("A", kind, domain)
        name, channels = STORED[kind]
        values = np.arange(len(made.data) * channels) % 11
        whole = kind in ("INT", "INT8")
        made.data.foreach_set(name, values % 3 == 0 if kind == "BOOLEAN" else values if whole else 0.2 + 0.07 * values)
    return Case("ShaderNodeAttribute", {}, {"attribute_name": "A"}, output, furnish=furnish, is_affine=False)


def of_property(kind, name, output="Color"):
    """An attribute that is not the mesh's."""
    def furnish(square):
        square["wear"], bpy.context.view_layer["wear"] = [0.2, 0.5, 0.7], 0.4
    return Case("ShaderNodeAttribute", {}, {"attribute_type": kind, "attribute_name": name}, output, furnish=furnish)


def second_uv(square):
    """A UV map that lies otherwise than the active one."""
    corners = square.data.uv_layers[0].uv
    flat = np.empty(2 * len(corners), np.float32)
    corners.foreach_get("vector", flat)
    turned = flat.reshape(-1, 2) @ np.float32([(0.3, 0.9), (-0.8, 0.4)])
    square.data.uv_layers.new(name="Turned").uv.foreach_set("vector", turned.ravel())


def bent(node):
    """Give the curves of a node some shape."""
    for i, curve in enumerate(node.mapping.curves):
        curve.points.new(0.3 + 0.1 * i, 0.6)
        curve.points.new(0.7, 0.45 + 0.1 * i)
    node.mapping.update()


def striped(kind, mode="RGB"):
    def prepare(node):
        ramp = node.color_ramp
        ramp.color_mode, ramp.interpolation = mode, kind
        ramp.elements[0].color, ramp.elements[1].color = (0.9, 0.1, 0.05, 0.3), (0.1, 0.2, 0.9, 1)
        ramp.elements.new(0.4).color = (0.2, 0.8, 0.3, 0.6)
    return prepare
