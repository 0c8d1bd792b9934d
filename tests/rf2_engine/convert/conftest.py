# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of the scene under test, and a shorthand for adding objects."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert


@pytest.fixture
def report():
    return Report()


@pytest.fixture
def converted(scene, report):
    """Function that converts the scene; by default nothing is simplified or subdivided, and no camera looks."""
    def run(token_budget=1_000_000, max_edge=1e6, seen=False, **choice):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        view = convert_camera(depsgraph, 64, 64, None) if seen else None
        return convert(depsgraph, view, ConversionOptions(token_budget, max_edge), report, **choice)
    return run


@pytest.fixture
def add_mesh(scene):
    """Function that links a mesh object made of vertices and faces (default: one triangle)."""
    def add(name, vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0)), faces=((0, 1, 2),), materials=()):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([tuple(v) for v in np.asarray(vertices, float)], [], list(faces))
        for material in materials:
            mesh.materials.append(material)
        obj = bpy.data.objects.new(name, mesh)
        bpy.context.scene.collection.objects.link(obj)
        return obj
    return add


@pytest.fixture
def add_material(scene):
    """Function that makes a Principled material of a colour and an emission strength."""
    def add(name, color=(0.8, 0.8, 0.8), emission=0.0):
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Base Color"].default_value = (*color, 1)
        inputs["Emission Color"].default_value = (1, 1, 1, 1)
        inputs["Emission Strength"].default_value = emission
        return material
    return add
