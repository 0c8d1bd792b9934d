# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between the supported Blender versions (4.5 LTS and 5.x), except pass names."""
from __future__ import annotations

import bpy


def world(depsgraph: bpy.types.Depsgraph) -> bpy.types.World | None:
    """The evaluated world of the view layer that is rendered."""
    return getattr(depsgraph.view_layer_eval, "world_override", None) or depsgraph.scene_eval.world


def set_file_format(settings: bpy.types.ImageFormatSettings, file_format: str) -> None:
    """Set `image_settings.file_format`; Blender 5 wants the media type first.

    A multilayer EXR gets one part with all passes, as 4.5 writes it: 5.x would write a part for each, and many readers
    open only the first. It is one file for all views of stereoscopy: `Image.save_render` fails where each has its own.
    """
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE" if file_format == "OPEN_EXR_MULTILAYER" else "IMAGE"
    settings.file_format = file_format
    if hasattr(settings, "use_exr_interleave"):
        settings.use_exr_interleave = True
    if file_format == "OPEN_EXR_MULTILAYER":
        settings.views_format = "MULTIVIEW"


def compositor(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The nodes that the pictures of a scene go through, if there are any."""
    if hasattr(scene, "compositing_node_group"):
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def add_compositor(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """A compositor for a scene that has none, with nothing but its output."""
    if hasattr(scene, "compositing_node_group"):
        tree = bpy.data.node_groups.new("Compositor Nodes", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    compositor_output(tree)
    return tree


def compositor_output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """The node whose Image is the picture; it is added where there is none."""
    is_group = "compositing_node_group" in bpy.types.Scene.bl_rna.properties
    kind = "NodeGroupOutput" if is_group else "CompositorNodeComposite"
    return next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)


def has_openimagedenoise() -> bool:
    """False in builds of Blender that were made without it."""
    import _cycles
    return getattr(_cycles, "with_openimagedenoise", True)


def working_space() -> str:
    """Name of the space in which the file's colours are numbers; it can be chosen from Blender 5 on."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else "Linear Rec.709"


def is_diced(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether Cycles divides the mesh of an object as its last modifier says, an experimental feature before 5.0."""
    last = obj.modifiers[-1] if obj.modifiers else None
    if last is None or last.type != "SUBSURF" or not last.show_render:
        return False
    if hasattr(last, "use_adaptive_subdivision"):
        return last.use_adaptive_subdivision
    return scene.cycles.feature_set == "EXPERIMENTAL" and obj.cycles.use_adaptive_subdivision


def ies_of_one_column_bulges() -> bool:
    """Whether Cycles brightens IES profiles that are alike all around by up to an eighth on one side, as 4.5 does."""
    return bpy.app.version < (5, 0)


def voronoi_uses_pcg() -> bool:
    """How the cells of Voronoi Texture are hashed: since Blender 5 another pattern comes out."""
    return bpy.app.version >= (5, 0)


def multiplies_premultiplied_files() -> bool:
    """Whether Cycles multiplies bytes of files whose alpha is premultiplied with it once more, as until 5.1."""
    return bpy.app.version < (5, 2)


def first_voxel_begins() -> float:
    """Where on each axis of a grid Cycles begins to draw voxel 0, in voxels: the grid's own place of it until 4.5."""
    return 0.0 if bpy.app.version < (5, 0) else -0.5


def set_video_format(render: bpy.types.RenderSettings) -> None:
    """MP4 of H.264 without visible loss; Blender 5 wants the media type first."""
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec, render.ffmpeg.constant_rate_factor = "MPEG4", "H264", "HIGH"


def add_image_strip(scene: bpy.types.Scene, files: list[str]) -> tuple[int, int]:
    """Show image files one after the other, from frame 1 on; returns the first one's width and height."""
    editor = scene.sequence_editor
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    for i, file in enumerate(files):
        strip = strips.new_image(name=file, filepath=file, channel=1, frame_start=1 + i)
        strip.transform.filter = "NEAREST"
    element = strips[0].elements[0]
    return element.orig_width, element.orig_height


def smooths_past_flat_faces() -> bool:
    """Whether smooth faces of Cycles have normals of vertices, which flat faces beside them share."""
    return bpy.app.version < (5, 2)
