# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of bake.py: Cycles bakes outputs of nodes on the triangles of objects, in a copy of the scene.

    blender --background --python bake_worker.py -- COPY.blend JOB.json
    python bake_worker.py -- COPY.blend JOB.json        # with the bpy module

Every line of standard input is a request, a JSON object; its result is saved in the file `answer`, then "baked" is
printed.
"""
import json
import sys
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

import mathutils

sys.path.append(str(Path(__file__).parent))
from background_worker import choose_devices, run  # noqa: E402  it lies beside this file

SCALE, OFFSET = 0.25, 0.5  # from values to emission, which is not negative, and 0 only where nothing is baked
REACH = 0.01               # length of baking rays, in sizes of the triangles
VISIBLE_TO = ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")


class BakedOutput(NamedTuple):
    """An output of a node, and the triangles of an object on which it is baked."""

    object_name: str
    matrix: list[list[float]]  # (4, 4) of the instance, object to world
    material_name: str
    groups: list[str]          # names of the group nodes that lead to the node
    node_name: str
    output: int                # number of the output
    triangles: str             # file of their corners (n, 3, 3), in the frame of the object
    side: int                  # texels along the edges of a triangle
    samples: int


def main() -> None:
    copy, settings = sys.argv[sys.argv.index("--") + 1:]
    job = json.loads(Path(settings).read_text())
    bpy.ops.wm.open_mainfile(filepath=copy, load_ui=False, use_scripts=False)
    choose_devices(job["compute_device_type"], job["devices"])
    scene = bpy.data.scenes[job["scene"]]
    scene.render.engine, scene.cycles.use_denoising, scene.cycles.device = "CYCLES", False, job["device"]
    scene.frame_set(job["frame"], subframe=job["subframe"])
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        np.save(request["answer"], bake(scene, scene.view_layers[job["layer"]], BakedOutput(**request["what"])))
        print("baked", flush=True)


def bake(scene, layer, what: BakedOutput) -> np.ndarray:
    """(n, side, side, 3) f32 of an output on n triangles; NaN where nothing was baked."""
    scene.cycles.samples = what.samples
    corners, matrix = np.load(what.triangles), mathutils.Matrix(what.matrix)
    _emit_output(bpy.data.materials[what.material_name].node_tree, what.groups, what.node_name, what.output)
    target = bpy.data.objects[what.object_name]
    stand_in = None
    if target.name not in layer.objects or np.abs(np.array(target.matrix_world - matrix)).max() > 1e-4:
        target = stand_in = target.copy()  # an instance, whose object may be elsewhere
        target.parent, target.matrix_world = None, matrix
        scene.collection.objects.link(target)
    image, tiles = _image(len(corners), what.side)
    atlas = _atlas(corners, tiles, image)
    atlas.matrix_world = matrix
    scene.collection.objects.link(atlas)
    target.hide_render = target.hide_viewport = False
    layer.update()
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max()) * max(matrix.to_scale())
    with bpy.context.temp_override(scene=scene, view_layer=layer, active_object=atlas, object=atlas,
                                   selected_objects=[target, atlas], selected_editable_objects=[target, atlas]):
        bpy.ops.object.bake(type="EMIT", use_selected_to_active=True, cage_extrusion=REACH * size, margin=0,
                            max_ray_distance=2 * REACH * size, use_clear=True)
    texels = _read_tiles(image, tiles, what.side)[:len(corners)]
    for data in (atlas, stand_in):
        if data:
            bpy.data.objects.remove(data)
    bpy.data.images.remove(image)
    return np.where(texels.any(axis=-1, keepdims=True), (texels - OFFSET) / SCALE, np.nan)


def _read_tiles(image, tiles: int, side: int) -> np.ndarray:
    """(tiles^2, side, side, 3) f32 of an image that has `tiles` tiles in a row."""
    pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(pixels)
    grid = pixels.reshape(tiles, side, tiles, side, 4).transpose(0, 2, 1, 3, 4)
    return grid.reshape(-1, side, side, 4)[..., :3]


def _image(count: int, side: int):
    """A float image for `count` tiles, and the number of them in a row."""
    tiles = int(np.ceil(np.sqrt(count)))
    image = bpy.data.images.new("Baked", tiles * side, tiles * side, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    return image, tiles


def _atlas(corners, tiles: int, image):
    """An object of the triangles, unwrapped to half a tile of the image each, into which they are baked."""
    count = len(corners)
    mesh = bpy.data.meshes.new("Atlas")
    mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], np.arange(3 * count).reshape(-1, 3).tolist())
    row, column = np.divmod(np.arange(count), tiles)
    uv = (np.stack([column, row], axis=-1)[:, None] + np.float32([(1, 0), (0, 1), (0, 0)])) / tiles
    mesh.uv_layers.new(name="Atlas").data.foreach_set("uv", uv.astype(np.float32).ravel())
    material = bpy.data.materials.new("Atlas")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    mesh.materials.append(material)
    atlas = bpy.data.objects.new("Atlas", mesh)
    for ray in VISIBLE_TO:
        setattr(atlas, f"visible_{ray}", False)
    return atlas


def _emit_output(tree, groups, node_name: str, output: int) -> None:
    """Make an output of a node, in the tree or in nested groups, the emission of the whole material."""
    trees, users = [tree], []
    for name in groups:
        users.append(trees[-1].nodes[name])
        trees.append(users[-1].node_tree)
    inner = trees[-1]
    emitted = inner.nodes[node_name].outputs[output]
    for inside, user in zip(reversed(trees[1:]), reversed(users), strict=True):
        group_output = inside.interface.new_socket("Shown", in_out="OUTPUT", socket_type="NodeSocketVector")
        end = next(node for node in inside.nodes if node.bl_idname == "NodeGroupOutput" and node.is_active_output)
        inside.links.new(emitted, next(entry for entry in end.inputs if entry.identifier == group_output.identifier))
        emitted = next(leave for leave in user.outputs if leave.identifier == group_output.identifier)
    scaled, emission = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeEmission")
    scaled.operation = "MULTIPLY_ADD"
    scaled.inputs[1].default_value, scaled.inputs[2].default_value = [SCALE] * 3, [OFFSET] * 3
    tree.links.new(emitted, scaled.inputs[0])
    tree.links.new(scaled.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


if __name__ == "__main__":
    run(main)
