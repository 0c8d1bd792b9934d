# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of a prepared frame as the shader nodes of its reference pictures (docs/scene-input.md 3.2, 3.5, 4.6)."""
from __future__ import annotations

from pathlib import Path

import bpy

from ...model.published.prepared_frame import HEIGHT, MAPS, MEASURED, FrameMaterial, map_file, maps
from ..convert.shading.material import HEIGHT_UNIT
from ..material_settings import read_latent, set_latent

GROUP = "SpecularRoughnessBSDF"  # by this name the authors' add-on knows it
UNKNOWN = (0.5, 0.5, 0.5)        # for a map that is not there
GREY = (0.4, 0.4, 0.4)           # for a latent, where only published weights look
COLORS = {"Diffuse": "diffuse", "Specular": "specular", "Base Color": "base_color"}
NUMBERS = {"Roughness": "roughness", "Metallic": "metallic", "Transmission Weight": "transmission_weight", "IOR": "ior"}
# Inputs by map; of the two shaders each has some of them.
INPUTS = {"diffuse": "Diffuse", "specular": "Specular", "basecolor": "Base Color", "metallic": "Metallic",
          "roughness": "Roughness"}


def build(name: str, material: FrameMaterial, folder: Path, report) -> bpy.types.Material:
    """A new material. Files of the folder that are missing are left out: the caller names them."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    if any(material.emission):
        shader = _emitter(nodes, material.emission)
    elif material.kind in ("homo_diffuse_specular", "svbrdf_diffuse_specular"):
        shader = nodes.new("ShaderNodeGroup")
        shader.node_tree = _diffuse_and_glossy()
    else:
        shader = _principled(nodes)
    made.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if not any(material.emission):
        _fill(made, shader, material, folder, report)
        if material.kind in MAPS:
            _add_maps(made, shader, output, material, folder)
    return made


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
    """The node group, one for the file; one of that name that is another is left alone."""
    sockets = (("Diffuse", "NodeSocketColor"), ("Specular", "NodeSocketColor"), ("Roughness", "NodeSocketFloat"),
               ("Normal", "NodeSocketVector"))
    wanted = [name for name, _ in sockets]
    for known in bpy.data.node_groups:
        if known.name.startswith(GROUP) and known.bl_idname == "ShaderNodeTree" and _inputs(known) == wanted:
            return known
    tree = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    for name, kind in sockets:
        socket = tree.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        if name == "Normal":
            socket.hide_value = True
    tree.interface.new_socket("BSDF", in_out="OUTPUT", socket_type="NodeSocketShader")
    given, result, diffuse, glossy, both = map(tree.nodes.new, (
        "NodeGroupInput", "NodeGroupOutput", "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfAnisotropic",
        "ShaderNodeAddShader"))
    glossy.distribution = "MULTI_GGX"
    for key, target in (("Diffuse", diffuse.inputs["Color"]), ("Specular", glossy.inputs["Color"]),
                        ("Roughness", glossy.inputs["Roughness"]), ("Normal", diffuse.inputs["Normal"]),
                        ("Normal", glossy.inputs["Normal"])):
        tree.links.new(given.outputs[key], target)
    tree.links.new(diffuse.outputs[0], both.inputs[0])
    tree.links.new(glossy.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], result.inputs[0])
    for x, node in ((-300, given), (0, diffuse), (0, glossy), (200, both), (400, result)):
        node.location = (x, -200 if node is glossy else 0)
    return tree


def _inputs(tree: bpy.types.NodeTree) -> list[str]:
    return [it.name for it in tree.interface.items_tree if it.item_type == "SOCKET" and it.in_out == "INPUT"]


def _fill(made, shader, material: FrameMaterial, folder: Path, report) -> None:
    """Numbers of homogeneous materials, or the latent."""
    for key, name in COLORS.items():
        if name in material.numbers:
            shader.inputs[key].default_value = (*material.numbers[name], 1)
    for key, name in NUMBERS.items():
        if name in material.numbers:
            shader.inputs[key].default_value = material.numbers[name]
    if material.kind == MEASURED:
        shader.inputs["Base Color"].default_value = (*GREY, 1)
        report.approximated(made.name, "its measured appearance is a latent, which published weights alone know: "
                                       "everything else shows it grey")
        if (file := folder / material.latent).is_file():
            try:
                set_latent(made, read_latent(file))
            except ValueError as error:
                report.refused(made.name, f"{file}: {error}")


def _numbers(file: Path) -> bpy.types.Image:
    """An image file as the numbers that it holds. One that is loaded with other settings belongs to somebody else."""
    for known in bpy.data.images:
        if (known.source == "FILE" and bpy.path.abspath(known.filepath) == str(file) and known.alpha_mode == "NONE"
                and known.colorspace_settings.name == "Non-Color"):
            return known
    made = bpy.data.images.load(str(file))
    made.colorspace_settings.name, made.alpha_mode = "Non-Color", "NONE"
    return made


def _add_maps(made, shader, output, material: FrameMaterial, folder: Path) -> None:
    nodes, links = made.node_tree.nodes, made.node_tree.links
    for row, name in enumerate(maps(material)):
        file = map_file(folder, material, name)
        if not file.is_file():
            if name in INPUTS:
                socket = shader.inputs[INPUTS[name]]
                socket.default_value = (*UNKNOWN, 1) if socket.type == "RGBA" else UNKNOWN[0]
            continue
        image = nodes.new("ShaderNodeTexImage")
        image.image = _numbers(file)
        image.location = (-600, 300 - 300 * row)
        if name == "normal":
            bump = nodes.new("ShaderNodeNormalMap")
            bump.location = (-300, -200)
            links.new(image.outputs["Color"], bump.inputs["Color"])
            links.new(bump.outputs["Normal"], shader.inputs["Normal"])
        elif name == HEIGHT:
            made.displacement_method = "BOTH"
            displacement = nodes.new("ShaderNodeDisplacement")
            displacement.location = (-300, -500)
            displacement.inputs["Midlevel"].default_value, displacement.inputs["Scale"].default_value = (
                0.5, 2 * HEIGHT_UNIT)
            links.new(image.outputs["Color"], displacement.inputs["Height"])
            links.new(displacement.outputs[0], output.inputs["Displacement"])
        else:
            links.new(image.outputs["Color"], shader.inputs[INPUTS[name]])


def medium(name: str, scattering, absorption) -> bpy.types.Material:
    """Coefficients in proportion to the grid "density" (docs/scene-input.md 5.4)."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output, coefficients, info = map(nodes.new, (
        "ShaderNodeOutputMaterial", "ShaderNodeVolumeCoefficients", "ShaderNodeVolumeInfo"))
    for key, scale in (("Scatter Coefficients", scattering), ("Absorption Coefficients", absorption)):
        times = nodes.new("ShaderNodeVectorMath")
        times.operation, times.inputs[1].default_value = "MULTIPLY", scale
        links.new(info.outputs["Density"], times.inputs[0])
        links.new(times.outputs[0], coefficients.inputs[key])
    coefficients.inputs["Anisotropy"].default_value = 0
    links.new(coefficients.outputs[0], output.inputs["Volume"])
    return made
