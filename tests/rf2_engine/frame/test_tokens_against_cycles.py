# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tokens say at each pixel is what Cycles' first hits say there: normals of every kind, and UVs as colours."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR, TILE_SIZE
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits

KINDS = {  # object: the claim
    "Flat": "a face has one normal", "Smooth": "normals are interpolated",
    "Mirrored": "negative scale turns no normal round",
    "Stretched": "normals follow the inverse transpose", "Sharp": "smooth faces break at sharp edges",
    "Custom": "custom normals are kept", "Weighted": "normals of a modifier are kept",
    "Instance": "an instance has the normals of its mesh, turned",
}
DEGREES = 0.5


def uv_as_color() -> bpy.types.Material:
    made = bpy.data.materials.new("UV")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    uv, shader, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "BsdfDiffuse", "OutputMaterial"))
    tree.links.new(uv.outputs[0], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def add(name, primitive, place, turn, **settings):
    primitive(location=place, rotation=turn, **settings)
    obj = bpy.context.object
    obj.name = name
    obj.data.materials.append(bpy.data.materials["UV"])
    return obj


def build(scene) -> None:
    uv_as_color()
    sphere, cube = bpy.ops.mesh.primitive_uv_sphere_add, bpy.ops.mesh.primitive_cube_add
    round_ = {"segments": 12, "ring_count": 8, "radius": 0.45}
    turn = 0.4, 0.3, 0.2
    places = [(x, 0, z) for z in (0.6, -0.6) for x in (-1.8, -0.6, 0.6, 1.8)]
    made = {name: add(name, cube if name in ("Sharp", "Weighted") else sphere, place, turn,
                      **({"size": 0.7} if name in ("Sharp", "Weighted") else round_))
            for name, place in zip(KINDS, places) if name != "Instance"}
    for name, obj in made.items():
        if name != "Flat":
            obj.data.shade_smooth()
    made["Mirrored"].scale.x = -1
    made["Stretched"].scale = 0.4, 1, 1
    for edge in made["Sharp"].data.edges[:6]:
        edge.use_edge_sharp = True
    custom = made["Custom"].data
    custom.normals_split_custom_set_from_vertices(
        [(v.co.normalized() * 0.7 + type(v.co)((0, 0, 0.5))).normalized() for v in custom.vertices])
    made["Weighted"].modifiers.new("Bevel", "BEVEL").width = 0.15
    made["Weighted"].modifiers.new("Weighted", "WEIGHTED_NORMAL")
    group = bpy.data.collections.new("Group")
    group.objects.link(made["Custom"])
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", group
    instance.location = places[-1][0] - places[5][0], 0, 0
    scene.collection.objects.link(instance)


@pytest.fixture
def pixels(scene, monkeypatch):
    """{object: (Cycles' normals, the tokens', Cycles' colours, the tokens')}, (P, 3) each, of pixels inside of it."""
    seen = []

    def record(found, tokens, view, real=first_hits.make_guides):
        seen.append((found, tokens, real(found, tokens, view)))
        raise RenderCancelled  # the network has nothing to do with it

    monkeypatch.setattr(first_hits, "make_guides", record)
    build(scene)
    scene.render.resolution_x, scene.render.resolution_y = 160, 96
    scene.renderformer_v2.light = "NETWORK"
    bpy.ops.render.render(scene=scene.name)
    (found, tokens, guides), = seen
    hit, place = found["alpha"][..., 0] == 1, found["position"]
    triangle, weights = guides.hit_triangle, guides.hit_barycentric
    weights = np.concatenate([weights, 1 - weights.sum(axis=-1, keepdims=True)], axis=-1)
    normals = (tokens.normals[triangle] * weights[..., None]).sum(axis=-2)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    column, row = (np.clip(weights[..., i] * TILE_SIZE, 0, TILE_SIZE - 1).astype(int) for i in (0, 1))
    colors = tokens.tiles[tokens.tile_index[triangle]][..., BASE_COLOR, :, :]
    colors = np.take_along_axis(np.take_along_axis(colors, row[..., None, None, None], -2),
                                column[..., None, None, None], -1)[..., 0, 0]
    middle = np.array(list(_places(scene)))
    nearest = np.linalg.norm(place[..., None, :] - middle, axis=-1).argmin(axis=-1)
    return {name: tuple(x[hit & (nearest == i)] for x in (found["normal"], normals, found["diffuse_color"], colors))
            for i, name in enumerate(KINDS)}


def _places(scene):
    """Where the objects stand, in their order."""
    for name in KINDS:
        obj = scene.objects[name]
        yield obj.location if name != "Instance" else obj.location + scene.objects["Custom"].location


def test_normals_and_uvs_are_those_of_cycles(pixels):
    for name, claim in KINDS.items():
        normals, ours, colors, our_colors = pixels[name]
        assert len(normals) > 100, name
        angle = np.degrees(np.arccos(np.clip((normals * ours).sum(axis=-1), -1, 1)))
        assert np.median(angle) < DEGREES and np.percentile(angle, 95) < 4 * DEGREES, f"{name}: {claim}"
        off = np.abs(colors - our_colors)[..., :2].max(axis=-1)
        assert np.median(off) < 0.01 and np.percentile(off, 95) < 0.03, f"{name}: UVs, {off.max()}"
