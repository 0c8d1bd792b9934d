# SPDX-License-Identifier: GPL-3.0-or-later
"""Create materials of a prepared frame with the shader nodes of its reference pictures (docs/scene-input.md 3.2, 3.5,
4.6)."""
from __future__ import annotations

from pathlib import Path

import bpy

from ...model.published.prepared_frame import HEIGHT, MAPS, MEASURED, FrameMaterial, list_maps, map_file
from ..convert.data.report import Report
from ..convert.shading.material import HEIGHT_UNIT
from ..material_settings import read_latent, set_latent

GROUP = "SpecularRoughnessBSDF"  # its name in the authors' add-on
MISSING = (0.5, 0.5, 0.5)        # for a map without a file
GREY = (0.4, 0.4, 0.4)           # for a latent, which only published weights read
COLORS = {"Diffuse": "diffuse", "Specular": "specular", "Base Color": "base_color"}
NUMBERS = {"Roughness": "roughness", "Metallic": "metallic", "Transmission Weight": "transmission_weight", "IOR": "ior"}
# Inputs by map; each of the two shaders has some of them.
INPUTS = {"diffuse": "Diffuse", "specular": "Specular", "basecolor": "Base Color", "metallic": "Metallic",
          "roughness": "Roughness"}


def create_material(name: str, material: FrameMaterial, folder: Path, report: Report) -> bpy.types.Material:
    """A new material. Missing files of the folder are left out; the caller reports them."""
    blender_material = bpy.data.materials.new(name)
    blender_material.use_nodes = True
    nodes = blender_material.node_tree.nodes
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    if any(material.emission):
        shader = _emitter(nodes, material.emission)
    elif material.kind in ("homo_diffuse_specular", "svbrdf_diffuse_specular"):
        shader = nodes.new("ShaderNodeGroup")
        shader.node_tree = _diffuse_and_glossy()
    else:
        shader = _principled(nodes)
    blender_material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if not any(material.emission):
        _set_values(blender_material, shader, material, folder, report)
        if material.kind in MAPS:
            _add_maps(blender_material, shader, output, material, folder)
    return blender_material


def _emitter(nodes, radiance) -> bpy.types.Node:
    shader, strength = _principled(nodes), max(radiance)
    values = {"Base Color": (1, 1, 1, 1), "Specular IOR Level": 0, "Roughness": 1,
              "Emission Color": (*(value / strength for value in radiance), 1), "Emission Strength": strength}
    for key, value in values.items():
        shader.inputs[key].default_value = value
    return shader


def _principled(nodes) -> bpy.types.Node:
    shader = nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Specular IOR Level"].default_value = 1
    shader.inputs["IOR"].default_value = 1.5
    return shader


def _diffuse_and_glossy() -> bpy.types.NodeTree:
    """The node group, one per file; a different one with its name is left alone."""
    sockets = (("Diffuse", "NodeSocketColor"), ("Specular", "NodeSocketColor"), ("Roughness", "NodeSocketFloat"),
               ("Normal", "NodeSocketVector"))
    names = [name for name, _ in sockets]
    for group in bpy.data.node_groups:
        if group.name.startswith(GROUP) and group.bl_idname == "ShaderNodeTree" and _inputs(group) == names:
            return group
    tree = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    for name, kind in sockets:
        socket = tree.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        if name == "Normal":
            socket.hide_value = True
    tree.interface.new_socket("BSDF", in_out="OUTPUT", socket_type="NodeSocketShader")
    inputs, outputs, diffuse, glossy, add = map(tree.nodes.new, (
        "NodeGroupInput", "NodeGroupOutput", "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfAnisotropic",
        "ShaderNodeAddShader"))
    glossy.distribution = "MULTI_GGX"
    for key, target in (("Diffuse", diffuse.inputs["Color"]), ("Specular", glossy.inputs["Color"]),
                        ("Roughness", glossy.inputs["Roughness"]), ("Normal", diffuse.inputs["Normal"]),
                        ("Normal", glossy.inputs["Normal"])):
        tree.links.new(inputs.outputs[key], target)
    tree.links.new(diffuse.outputs[0], add.inputs[0])
    tree.links.new(glossy.outputs[0], add.inputs[1])
    tree.links.new(add.outputs[0], outputs.inputs[0])
    for x, node in ((-300, inputs), (0, diffuse), (0, glossy), (200, add), (400, outputs)):
        node.location = (x, -200 if node is glossy else 0)
    return tree


def _inputs(tree: bpy.types.NodeTree) -> list[str]:
    return [item.name for item in tree.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT"]


def _set_values(blender_material, shader, material: FrameMaterial, folder: Path, report: Report) -> None:
    """Set the numbers of a homogeneous material, or the latent."""
    for key, name in COLORS.items():
        if name in material.numbers:
            shader.inputs[key].default_value = (*material.numbers[name], 1)
    for key, name in NUMBERS.items():
        if name in material.numbers:
            shader.inputs[key].default_value = material.numbers[name]
    if material.kind == MEASURED:
        shader.inputs["Base Color"].default_value = (*GREY, 1)
        report.approximated(blender_material.name, "its measured appearance is a latent, which published weights alone "
                                                   "know: everything else shows it grey")
        if (file := folder / material.latent).is_file():
            try:
                set_latent(blender_material, read_latent(file))
            except ValueError as error:
                report.refused(blender_material.name, f"{file}: {error}")


def _load_numbers(file: Path) -> bpy.types.Image:
    """An image file as numbers. An image of the file with other settings is left alone."""
    for image in bpy.data.images:
        if (image.source == "FILE" and bpy.path.abspath(image.filepath) == str(file) and image.alpha_mode == "NONE"
                and image.colorspace_settings.name == "Non-Color"):
            return image
    image = bpy.data.images.load(str(file))
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "NONE"
    return image


def _add_maps(blender_material, shader, output, material: FrameMaterial, folder: Path) -> None:
    nodes, links = blender_material.node_tree.nodes, blender_material.node_tree.links
    for row, name in enumerate(list_maps(material)):
        file = map_file(folder, material, name)
        if not file.is_file():
            if name in INPUTS:
                socket = shader.inputs[INPUTS[name]]
                socket.default_value = (*MISSING, 1) if socket.type == "RGBA" else MISSING[0]
            continue
        image = nodes.new("ShaderNodeTexImage")
        image.image = _load_numbers(file)
        image.location = (-600, 300 - 300 * row)
        if name == "normal":
            bump = nodes.new("ShaderNodeNormalMap")
            bump.location = (-300, -200)
            links.new(image.outputs["Color"], bump.inputs["Color"])
            links.new(bump.outputs["Normal"], shader.inputs["Normal"])
        elif name == HEIGHT:
            blender_material.displacement_method = "BOTH"
            displacement = nodes.new("ShaderNodeDisplacement")
            displacement.location = (-300, -500)
            displacement.inputs["Midlevel"].default_value, displacement.inputs["Scale"].default_value = (
                0.5, 2 * HEIGHT_UNIT)
            links.new(image.outputs["Color"], displacement.inputs["Height"])
            links.new(displacement.outputs[0], output.inputs["Displacement"])
        else:
            links.new(image.outputs["Color"], shader.inputs[INPUTS[name]])


def create_medium(name: str, scattering, absorption) -> bpy.types.Material:
    """A new material of a volume, with coefficients in proportion to the grid "density" (docs/scene-input.md 5.4)."""
    blender_material = bpy.data.materials.new(name)
    blender_material.use_nodes = True
    nodes, links = blender_material.node_tree.nodes, blender_material.node_tree.links
    nodes.clear()
    output, coefficients, info = map(nodes.new, (
        "ShaderNodeOutputMaterial", "ShaderNodeVolumeCoefficients", "ShaderNodeVolumeInfo"))
    for key, scale in (("Scatter Coefficients", scattering), ("Absorption Coefficients", absorption)):
        product = nodes.new("ShaderNodeVectorMath")
        product.operation, product.inputs[1].default_value = "MULTIPLY", scale
        links.new(info.outputs["Density"], product.inputs[0])
        links.new(product.outputs[0], coefficients.inputs[key])
    coefficients.inputs["Anisotropy"].default_value = 0
    links.new(coefficients.outputs[0], output.inputs["Volume"])
    return blender_material
