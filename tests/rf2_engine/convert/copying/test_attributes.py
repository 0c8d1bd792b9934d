# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of instances are found by their numbers, however many there are."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.attributes import Asked

from tests.rf2_engine.convert.cycles_reference import material

SIDE = 12  # points along the grid that is grown


@pytest.fixture
def grown(scene, add_mesh):
    """Function that grows some geometry on a grid of points in the plane and gives, of each instance, its place in the
    world and its attribute "at", which is the place of its point; and what the instancer knows."""
    made, tree, shader = material("ShaderNodeEmission", "Told")
    asked = tree.nodes.new("ShaderNodeAttribute")
    asked.attribute_type, asked.attribute_name = "INSTANCER", "at"
    tree.links.new(asked.outputs["Color"], shader.inputs["Color"])
    leaf = add_mesh("Leaf", materials=[made])
    leaf.location = (7, 0, 0)
    at = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), [0]), axis=-1).reshape(-1, 3)
    field = add_mesh("Field", at, ())
    group = bpy.data.node_groups.new("Grow", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")

    def grow(build):
        begin, end, joined = (group.nodes.new(kind) for kind in (
            "NodeGroupInput", "NodeGroupOutput", "GeometryNodeJoinGeometry"))
        build(group, leaf, begin.outputs[0], joined.inputs[0])
        group.links.new(joined.outputs[0], end.inputs[0])
        field.modifiers.new("Grow", "NODES").node_group = group
        depsgraph = bpy.context.evaluated_depsgraph_get()
        asked, found = Asked(depsgraph), []
        for instance in depsgraph.object_instances:
            if instance.is_instance and instance.object.type == "MESH":
                found.append((np.array(instance.matrix_world)[:3, 3], asked.of_instancer(instance)["at"]))
        [instances] = asked.instances.values()
        return *map(np.array, zip(*found, strict=True)), instances

    return grow


def scatter(group, source, what, to, number=None):
    """Instances of `what` on the points of `source`, with an id of their own if `number` says which."""
    points = source
    if number is not None:
        numbered = group.nodes.new("GeometryNodeSetID")
        group.links.new(source, numbered.inputs["Geometry"])
        group.links.new(number, numbered.inputs["ID"])
        points = numbered.outputs[0]
    instances, stored, at = (group.nodes.new(kind) for kind in (
        "GeometryNodeInstanceOnPoints", "GeometryNodeStoreNamedAttribute", "GeometryNodeInputPosition"))
    stored.data_type, stored.domain, stored.inputs["Name"].default_value = "FLOAT_VECTOR", "INSTANCE", "at"
    for first, second in ((points, instances.inputs["Points"]), (what, instances.inputs["Instance"]),
                          (instances.outputs[0], stored.inputs[0]), (stored.outputs[0], to),
                          (at.outputs[0], next(s for s in stored.inputs if s.name == "Value" and s.enabled))):
        group.links.new(first, second)


def numbers(group):
    """Ids that are in no order, some of them twice."""
    number = group.nodes.new("FunctionNodeRandomValue")
    number.data_type = "INT"
    low, high = (next(s for s in number.inputs if s.name == name and s.enabled) for name in ("Min", "Max"))
    low.default_value, high.default_value = 0, 3 * SIDE * SIDE
    return next(s for s in number.outputs if s.enabled)


def test_numbered_instances_are_found_without_looking_at_others(grown):
    def build(group, leaf, source, to):
        one = group.nodes.new("GeometryNodeObjectInfo")
        one.inputs["Object"].default_value = leaf
        for _ in range(2):  # of which the second ones have the numbers of the first
            scatter(group, source, one.outputs["Geometry"], to, numbers(group))

    place, told, instances = grown(build)
    assert len(place) == 2 * SIDE * SIDE and instances.searches == 0
    np.testing.assert_allclose(told, place, atol=1e-5)


def test_what_is_within_an_instance_has_its_attributes(grown):
    """A leaf far from the middle of its collection, nearer to other instances of that."""
    def build(group, leaf, source, to):
        collection = bpy.data.collections.new("Twig")
        collection.objects.link(leaf)
        whole = group.nodes.new("GeometryNodeCollectionInfo")
        whole.inputs["Collection"].default_value = collection
        scatter(group, source, whole.outputs[0], to)

    place, told, instances = grown(build)
    assert len(place) == SIDE * SIDE and instances.searches == 0
    np.testing.assert_allclose(told, place - (7, 0, 0), atol=1e-5)
