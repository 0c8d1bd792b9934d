# SPDX-License-Identifier: GPL-3.0-or-later
"""Many node graphs in one picture of Cycles: each glows on a square of its own, seen from straight above.

A pixel of a square is a texel of the tile that the evaluator makes of the same graph.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.model.scene import TILE_SIZE
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.attributes import MESH, RequestedAttributes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.instances import read_instance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.evaluate import Evaluator
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.points import surface_points

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material, rendered

CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
TILT = np.array([0.37, -0.23])  # of the squares, so that three dimensions are seen


@dataclass
class Case:
    """One node of a kind. inputs: values by name or number; the name of a SOURCE is a link to it."""

    kind: str
    inputs: dict = field(default_factory=dict)
    settings: dict = field(default_factory=dict)
    output: object = 0                            # name or number
    prepare: object = lambda node: None
    furnish: object = lambda square: None         # given the object
    is_reported: bool = False                     # whether a line about it is expected
    is_affine: bool = True                        # else the texels beyond the triangle are another's

    def __str__(self):
        told = [*self.settings.values(), *(f"{k}={v}" for k, v in self.inputs.items() if k != "Vector")]
        return " ".join(map(str, [self.kind, *told, "" if self.output == 0 else self.output])).strip()


def _scaled(tree, output, factor, offset, operation="MULTIPLY_ADD"):
    parts = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(output, parts[0].inputs[0])
    for i in range(3):
        math = tree.nodes.new("ShaderNodeMath")
        math.operation = operation
        math.inputs[1].default_value, math.inputs[2].default_value = factor, offset
        tree.links.new(parts[0].outputs[i], math.inputs[0])
        tree.links.new(math.outputs[0], parts[1].inputs[i])
    return parts[1].outputs[0]


def _steps(tree, at):
    return _scaled(tree, _scaled(tree, at, 1, 1e-3), 0.25, 0, "SNAP")


def _channel(tree, at, index):
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(at, parts.inputs[0])
    return parts.outputs[index]


def _height(tree, at):
    waves = tree.nodes.new("ShaderNodeVectorMath")
    waves.operation = "SINE"
    tree.links.new(_scaled(tree, at, 2.5, 0.3), waves.inputs[0])
    return _channel(tree, waves.outputs[0], 0)


SOURCES = {
    "at": lambda tree, at: at,                                     # (x, y, z) of the object, x and y from -1 to 1
    "color": lambda tree, at: _scaled(tree, at, 0.5, 0.5),         # x and y from 0 to 1
    "other": lambda tree, at: _scaled(tree, at, -0.31, 0.45),
    "wide": lambda tree, at: _scaled(tree, at, 1.15, 1.2),         # x and y from 0.05 to 2.35
    "steps": _steps,                                               # the same over squares of 4 x 4 pixels
    "x": lambda tree, at: _channel(tree, at, 0), "y": lambda tree, at: _channel(tree, at, 1),
    "height": lambda tree, at: _height(tree, at),
    "step": lambda tree, at: _channel(tree, _steps(tree, at), 0),
}


def build(case: Case, name: str):
    """A material that shows the node."""
    made, tree, emission = material("ShaderNodeEmission", name, Strength=1.0)
    made.cycles.emission_sampling = "NONE"
    at = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    node = tree.nodes.new(case.kind)
    for key, value in case.settings.items():
        setattr(node, key, value)
    case.prepare(node)
    for key, value in case.inputs.items():
        entry = node.inputs[key] if isinstance(key, int) else next(
            s for s in node.inputs if s.enabled and s.name == key)
        if isinstance(value, str):
            tree.links.new(SOURCES[value](tree, at), entry)
        else:
            entry.default_value = value
    outputs = [s for s in node.outputs if s.enabled]
    chosen = outputs[case.output] if isinstance(case.output, int) else next(
        s for s in outputs if s.name.startswith(case.output))
    tree.links.new(chosen, emission.inputs["Color"])
    return made


def compare(cases: list[Case]) -> list[tuple[np.ndarray, np.ndarray, list[str]]]:
    """For each case what the evaluator says and what Cycles shows, (texels, 3) each, and the lines of the report."""
    scene = empty_cycles_scene(samples=1)
    columns = int(np.ceil(np.sqrt(len(cases))))
    rows = -(-len(cases) // columns)
    for i, case in enumerate(cases):
        case.furnish(_square(i, build(case, f"Case {i}"), (2 * (i % columns), 2 * (i // columns), 0)))
    _camera(scene, columns, rows)
    picture, found = rendered(scene), []
    depsgraph = bpy.context.evaluated_depsgraph_get()
    asked = RequestedAttributes(depsgraph)
    places = {instance.object.name: read_instance(instance, scene.frame_current, asked)
              for instance in depsgraph.object_instances}
    for i, case in enumerate(cases):
        row, column = TILE_SIZE * (i // columns), TILE_SIZE * (i % columns)
        shown = picture[row:row + TILE_SIZE, column:column + TILE_SIZE]
        report = Report()
        ours = evaluated(places[f"Square {i}"], bpy.data.objects[f"Square {i}"], report, asked)
        whole = np.indices((TILE_SIZE, TILE_SIZE)).sum(axis=0) < (2 * TILE_SIZE if case.is_affine else TILE_SIZE - 1)
        found.append((ours[whole], shown[whole], report.lines()))
    return found


def evaluated(place, obj, report, asked) -> np.ndarray:
    """(32, 32, 3) colour that reaches the Emission node of a square, row 0 at the bottom as in the picture."""
    mesh = read_mesh(obj.data, obj.name, report, asked.names[MESH]).take([0])
    mesh = mesh.mapped(lambda layer: layer[:, CORNER_ORDER])
    points = surface_points(mesh, place)
    made = copied(obj.active_material)
    evaluator = Evaluator(points, made.node_tree.conventions, report, obj.name)
    evaluator.material_index = made.pass_index
    emission = made.node_tree.output.inputs["Surface"].source.node
    value = evaluator.value(emission.inputs["Color"])
    assert value.ndim in (1, 4)
    return np.broadcast_to(value, (1, TILE_SIZE, TILE_SIZE, 3))[0]


CORNER_ORDER = [1, 2, 0]  # the tile's first row and column run along the edges that meet in its third corner


def _square(i, made, location):
    mesh = bpy.data.meshes.new(f"Square {i}")
    mesh.from_pydata([(x, y, TILT @ (x, y) + 0.13) for x, y in CORNERS], [], [(0, 1, 3), (1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", (CORNERS[[0, 1, 3, 1, 2, 3]] / 2 + 0.5).ravel())
    mesh.materials.append(made)
    obj = bpy.data.objects.new(f"Square {i}", mesh)
    obj.location, obj.pass_index, obj.color = location, i + 1, (0.1, 0.2, 0.3, 0.4)
    obj.scale = (1, 1, 0.6)
    made.pass_index = 2 * i
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _camera(scene, columns, rows):
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale, data.sensor_fit = "ORTHO", 2 * columns, "HORIZONTAL"
    camera = bpy.data.objects.new("Camera", data)
    camera.location = (columns - 1, rows - 1, 10)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = columns * TILE_SIZE, rows * TILE_SIZE
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    bpy.context.view_layer.update()


def error(ours: np.ndarray, cycles: np.ndarray) -> float:
    """Mean difference over the mean value."""
    return float(np.abs(ours - cycles).mean() / max(np.abs(cycles).mean(), 1e-3))
