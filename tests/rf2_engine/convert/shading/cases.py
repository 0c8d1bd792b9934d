# SPDX-License-Identifier: GPL-3.0-or-later
"""Value nodes to be compared with Cycles: SOME of each kind, and EVERY mode of all."""
import itertools

import bpy

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.attributes import STORED

from tests.rf2_engine.convert.shading.kinds import (
    attribute,
    bent,
    map_range,
    maths,
    mix,
    noise,
    of_color,
    of_property,
    rotate,
    second_uv,
    striped,
    texture,
    transform,
    vector_math,
    voronoi,
)
from tests.rf2_engine.convert.shading.squares import Case

BLENDS = ("MIX DARKEN MULTIPLY BURN LIGHTEN SCREEN DODGE ADD OVERLAY SOFT_LIGHT LINEAR_LIGHT DIFFERENCE EXCLUSION "
          "SUBTRACT DIVIDE HUE SATURATION COLOR VALUE").split()
MATHS = (
    "ADD SUBTRACT MULTIPLY DIVIDE MULTIPLY_ADD POWER LOGARITHM SQRT INVERSE_SQRT ABSOLUTE EXPONENT MINIMUM MAXIMUM "
    "LESS_THAN GREATER_THAN SIGN COMPARE SMOOTH_MIN SMOOTH_MAX ROUND FLOOR CEIL TRUNC FRACT MODULO FLOORED_MODULO WRAP "
    "SNAP PINGPONG SINE COSINE TANGENT ARCSINE ARCCOSINE ARCTANGENT ARCTAN2 SINH COSH TANH RADIANS DEGREES").split()
VECTOR_MATHS = (
    "ADD SUBTRACT MULTIPLY DIVIDE MULTIPLY_ADD CROSS_PRODUCT PROJECT REFLECT REFRACT FACEFORWARD DOT_PRODUCT DISTANCE "
    "LENGTH SCALE NORMALIZE ABSOLUTE POWER SIGN MINIMUM MAXIMUM FLOOR CEIL FRACTION MODULO WRAP SNAP SINE COSINE "
    "TANGENT").split()
DIMENSIONS = "1D 2D 3D 4D".split()
FRACTALS = "MULTIFRACTAL RIDGED_MULTIFRACTAL HYBRID_MULTIFRACTAL FBM HETERO_TERRAIN".split()
SOME = [
    *(voronoi(f, "3D") for f in ("F1", "F2", "SMOOTH_F1", "DISTANCE_TO_EDGE", "N_SPHERE_RADIUS")),
    *(voronoi("F1", d, "Color") for d in DIMENSIONS),
    voronoi("F1", "2D", "Position", "MINKOWSKI", Exponent=1.4), voronoi("F2", "3D", "Position", "MANHATTAN"),
    voronoi("SMOOTH_F1", "3D", "Color", Smoothness=0.6), voronoi("F1", "2D", 0, "CHEBYCHEV", Randomness=0.5),
    voronoi("F1", "3D", 0, Detail=2.4, Roughness=0.6, Lacunarity=2.2, normalize=True),
    voronoi("DISTANCE_TO_EDGE", "2D", 0, Detail=1.6, Roughness=0.7, normalize=True),
    texture("Wave", Distortion=2.0, Detail_Roughness=0.6, settings={"wave_type": "BANDS"}),
    texture("Wave", settings={"wave_type": "RINGS", "wave_profile": "SAW"}),
    texture("Brick"), texture("Brick", "Fac", Mortar_Smooth=0.3, Bias=0.2), texture("Magic"),
    Case("ShaderNodeTexWhiteNoise", {"Vector": "steps"}, {"noise_dimensions": "3D"}, "Color"),
    texture("Gabor", Anisotropy=0.6), texture("Gradient", settings={"gradient_type": "RADIAL"}),
    *(noise(d, "FBM", "Color", Detail=1.5, Distortion=0.6) for d in DIMENSIONS),
    noise("3D", "FBM", Scale=80.0),
    *(noise("3D", kind, normalize=False, Detail=2.5) for kind in FRACTALS if kind != "FBM"),
    *(mix(kind) for kind in BLENDS),
    Case("ShaderNodeMix", {"A": "at", "B": "other", "Factor": (0.2, 0.9, 0.5)},
         {"data_type": "VECTOR", "factor_mode": "NON_UNIFORM"}),
    *(maths(kind) for kind in ("SMOOTH_MIN", "SMOOTH_MAX", "WRAP", "SINH", "COSH", "TANH", "PINGPONG")),
    maths("ADD", use_clamp=True),
    *(vector_math(kind) for kind in "MULTIPLY_ADD PROJECT REFRACT FACEFORWARD POWER SIGN WRAP SNAP".split()),
    map_range("STEPPED", True, False), map_range("SMOOTHERSTEP", False, True),
    Case("ShaderNodeCombineColor", {0: "x", 1: 0.4, 2: "y"}, {"mode": "HSL"}),
    *(of_color("SeparateColor", i, {"mode": "HSL"}) for i in range(3)),
    Case("ShaderNodeUVMap", {}, {"uv_map": "Turned"}, furnish=second_uv), Case("ShaderNodeUVMap"),
    rotate("AXIS_ANGLE"), rotate("EULER_XYZ", invert=True), transform("NORMAL", "OBJECT", "WORLD"),
    Case("ShaderNodeBlackbody", {"Temperature": 4000.0}),

    of_color("RGBToBW"), of_color("Gamma", Gamma=1.7), Case("ShaderNodeInvert", {0: 0.7, 1: "color"}),
    Case("ShaderNodeBrightContrast", {0: "color", 1: 0.1, 2: 0.4}),
    Case("ShaderNodeHueSaturation", {0: 0.7, 1: 1.3, 2: 0.9, 3: 0.8, 4: "color"}),
    Case("ShaderNodeValToRGB", {0: "x"}, prepare=striped("EASE")), texture("Checker", Scale=3.3),
    *(Case("ShaderNodeMapping", {0: "at", 1: (0.2, 0.1, 0.3), 2: (0.2, 0.4, 0.5), 3: (0.8, 1.3, 1)},
           {"vector_type": k}) for k in ("POINT", "TEXTURE", "VECTOR", "NORMAL")),
    Case("ShaderNodeVectorCurve", {0: 0.8, 1: "at"}, prepare=bent),
    Case("ShaderNodeRGBCurve", {"Color": "color"}, prepare=bent),
    Case("ShaderNodeNormal", {"Normal": "at"}, output="Dot"),
    *(Case("ShaderNodeObjectInfo", output=i) for i in range(6)),
    *(Case("ShaderNodeNewGeometry", output=name)
      for name in ("Position", "Normal", "True Normal", "Random Per Island")),
    Case("ShaderNodeTexCoord", output="Normal"), Case("ShaderNodeTexCoord", output="Generated"),
    *(Case("ShaderNodeParticleInfo", output=name) for name in ("Random", "Size")),
    Case("ShaderNodeBump", {"Height": "height", "Distance": 0.4, "Strength": 0.7}),
    Case("ShaderNodeBump", {"Height": "height", "Distance": 0.4}, {"invert": True}),
    *(Case("ShaderNodeNormalMap", {"Color": "color", "Strength": 0.8}, {"space": space})
      for space in "TANGENT OBJECT WORLD BLENDER_OBJECT BLENDER_WORLD".split()),
    Case("ShaderNodeNormalMap", {"Color": "color"}, {"uv_map": "Turned"}, furnish=second_uv),
    Case("ShaderNodeNormalMap", {"Color": "color"}, {"uv_map": "Gone"}, is_reported=True),
    Case("ShaderNodeNormalMap", {"Color": "color", "Strength": 1.7}),
    Case("ShaderNodeHairInfo", output="Is Strand"),
    *(attribute(domain, kind, output) for domain, kind, output in (
        ("POINT", "FLOAT2", "Fac"), ("EDGE", "FLOAT", "Color"), ("EDGE", "BOOLEAN", "Fac"),
        ("FACE", "FLOAT_VECTOR", "Vector"), ("CORNER", "INT", "Fac"), ("POINT", "INT8", "Color"),
        ("CORNER", "BYTE_COLOR", "Alpha"), ("FACE", "FLOAT_COLOR", "Color"), ("POINT", "QUATERNION", "Vector"),
        ("CORNER", "FLOAT2", "Vector"))),
    of_property("OBJECT", "wear"), of_property("OBJECT", "location"), of_property("OBJECT", "pass_index", "Fac"),
    of_property("INSTANCER", "wear", "Vector"), of_property("VIEW_LAYER", "wear"),
    of_property("VIEW_LAYER", "frame_current", "Fac"),
    Case("ShaderNodeTexWhiteNoise", {"Vector": (0.3, 0.2, 0.4)}, {"noise_dimensions": "3D"}, "Color"),
]
EVERY = [
    *(voronoi(f, d, o) for f, d in itertools.product(("F1", "F2", "SMOOTH_F1"), DIMENSIONS) for o in range(3)),
    *(voronoi(f, d) for f, d in itertools.product(("DISTANCE_TO_EDGE", "N_SPHERE_RADIUS"), DIMENSIONS)),
    *(voronoi(f, "3D", o, m) for f, m in itertools.product(
        ("F1", "F2", "SMOOTH_F1"), ("MANHATTAN", "CHEBYCHEV", "MINKOWSKI")) for o in range(2)),
    *(voronoi(f, d, o, Detail=2.3, Roughness=0.6, Lacunarity=1.8, Randomness=0.8, normalize=n) for f, d, o, n in
      itertools.product(("F1", "F2", "SMOOTH_F1"), DIMENSIONS, range(3), (False, True))),
    *(voronoi("DISTANCE_TO_EDGE", d, Detail=2.3, Roughness=0.6, Lacunarity=1.8, Randomness=0.8, normalize=n) for d, n in
      itertools.product(DIMENSIONS, (False, True))),
    *(voronoi("F1", d, "W") for d in ("1D", "4D")),
    *(texture("Wave", settings={"wave_type": "BANDS", "bands_direction": d, "wave_profile": p}, Distortion=x)
      for d, p, x in itertools.product("X Y Z DIAGONAL".split(), "SIN SAW TRI".split(), (0.0, 1.3))),
    *(texture("Wave", settings={"wave_type": "RINGS", "rings_direction": d}, Phase_Offset=0.7)
      for d in "X Y Z SPHERICAL".split()),
    *(texture("Brick", o, {"offset": 0.3, "offset_frequency": f, "squash": 1.4, "squash_frequency": s}, Scale=3.0,
              Mortar_Size=0.05, Mortar_Smooth=m) for o, f, s, m in itertools.product(
                  range(2), (0, 2, 3), (2, 3), (0.0, 0.5, 1.0))),
    *(texture("Magic", o, {"turbulence_depth": depth}, Scale=2.0, Distortion=d) for o, depth, d in
      itertools.product(range(2), range(11), (1.0, 1.7))),
    *(Case("ShaderNodeTexWhiteNoise", {} if d == "1D" else {"Vector": "steps"}, {"noise_dimensions": d}, o)
      for d in ("2D", "3D") for o in range(2)),
    *(Case("ShaderNodeTexWhiteNoise", {"W": "step"}, {"noise_dimensions": "1D"}, o) for o in range(2)),
    *(Case("ShaderNodeTexWhiteNoise", {"Vector": "steps", "W": 0.3}, {"noise_dimensions": "4D"}, o) for o in range(2)),
    *(texture("Gabor", o, {"gabor_type": d}, Anisotropy=a, Frequency=1.5) for d, o, a in itertools.product(
        ("2D", "3D"), range(3), (0.0, 0.5, 1.0))),
    *(texture("Gradient", settings={"gradient_type": kind}) for kind in
      "LINEAR QUADRATIC EASING DIAGONAL SPHERICAL QUADRATIC_SPHERE RADIAL".split()),
    *(texture("Checker", o, Scale=3.3) for o in range(2)),
    *(noise(d, kind, o, n, Detail=2.4, Roughness=0.6, Lacunarity=1.9, **extra) for d, kind, o, n in itertools.product(
        DIMENSIONS, FRACTALS, range(2), (False, True)) for extra in ({}, {"Distortion": 0.7})),
    *(mix(kind, clamp_result=c) for kind in BLENDS for c in (False, True)),
    *(Case("ShaderNodeMixRGB", {0: "x", 1: "color", 2: "other"}, {"blend_type": k})
      for k in BLENDS),
    Case("ShaderNodeMix", {"A": "x", "B": "y", "Factor": 0.3}, {"data_type": "FLOAT"}),
    Case("ShaderNodeMix", {"A": "at", "B": "other", "Factor": "x"}, {"data_type": "VECTOR", "clamp_factor": False}),
    *(maths(kind, use_clamp=c) for kind in MATHS for c in (False, True)),
    *(vector_math(kind) for kind in VECTOR_MATHS),
    *(map_range(k, v, c) for k, v, c in itertools.product(
        "LINEAR STEPPED SMOOTHSTEP SMOOTHERSTEP".split(), (False, True), (False, True))),
    *(Case("ShaderNodeClamp", {"Value": "x", "Min": 0.5, "Max": 0.1}, {"clamp_type": k}) for k in ("MINMAX", "RANGE")),
    *(Case("ShaderNodeCombineColor", {0: "x", 1: 0.4, 2: "y"}, {"mode": m}) for m in ("RGB", "HSV", "HSL")),
    *(of_color("SeparateColor", i, {"mode": m}) for i in range(3) for m in ("RGB", "HSV", "HSL")),
    *(rotate(k, invert=i) for k in "AXIS_ANGLE X_AXIS Y_AXIS Z_AXIS EULER_XYZ".split() for i in (False, True)),
    *(transform(k, s, t) for k in ("POINT", "VECTOR", "NORMAL") for s, t in (("OBJECT", "WORLD"), ("WORLD", "OBJECT"))),
    *(Case("ShaderNodeBlackbody", {"Temperature": t}) for t in (500.0, 1000.0, 2500.0, 6500.0, 11000.0, 15000.0)),
    of_color("RGBToBW"), of_color("Gamma", Gamma=1.7), Case("ShaderNodeInvert", {0: 0.7, 1: "color"}),
    Case("ShaderNodeBrightContrast", {0: "color", 1: 0.1, 2: 0.4}),
    *(Case("ShaderNodeHueSaturation", {0: h, 1: 1.3, 2: 0.9, 3: 0.8, 4: "color"}) for h in (0.2, 0.5, 0.9)),
    Case("ShaderNodeVectorCurve", {0: 0.8, 1: "at"}, prepare=bent),
    Case("ShaderNodeRGBCurve", {0: 0.8, 1: "color"}, prepare=bent),
    Case("ShaderNodeRGBCurve", {"Color": "at"}, prepare=bent),
    Case("ShaderNodeFloatCurve", {0: 0.8, 1: "x"}, prepare=bent),
    *(Case("ShaderNodeValToRGB", {0: "x"}, output=o, prepare=striped(k, m)) for o, k, m in itertools.product(
        range(2), "LINEAR CONSTANT EASE CARDINAL B_SPLINE".split(), ("RGB", "HSV", "HSL"))),
    *(Case("ShaderNodeNormal", {"Normal": "at"}, output=name) for name in ("Normal", "Dot")),
    *(Case("ShaderNodeMapping", {0: "at", 1: (0.2, 0.1, 0.3), 2: (0.2, 0.4, 0.5), 3: (0.8, 1.3, 1)},
           {"vector_type": k}) for k in ("POINT", "TEXTURE", "VECTOR", "NORMAL")),
    Case("ShaderNodeMapping", {"Vector": "at", "Rotation": "at"}), Case("ShaderNodeSeparateXYZ", {0: "at"}, output=2),
    Case("ShaderNodeCombineXYZ", {0: "x", 1: 0.4, 2: "y"}),
    *(Case("ShaderNodeTexCoord", output=name) for name in ("Generated", "Normal", "UV", "Object")),
    *(Case("ShaderNodeParticleInfo", output=i) for i in range(8)),
    *(Case("ShaderNodeHairInfo", output=i) for i in range(6)),
    *(Case("ShaderNodePointInfo", output=i) for i in range(3)),
    *(attribute(domain, kind, output) for domain, kind, output in itertools.product(
        ("POINT", "EDGE", "FACE", "CORNER"), STORED, ("Color", "Vector", "Fac", "Alpha"))
      if domain != "EDGE" or kind not in ("BYTE_COLOR", "QUATERNION")),  # their means are other ones
]
if bpy.app.version < (5, 0):
    EVERY += [Case("ShaderNodeCombineHSV", {0: "x", 1: 0.4, 2: "y"}),
             *(Case("ShaderNodeSeparateHSV", {0: "color"}, output=i) for i in range(3))]
