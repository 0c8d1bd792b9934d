# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's own panoramas, meshes and maps (own_files.py) as Blender's data. An unusable file is reported once."""
from __future__ import annotations

from pathlib import Path

import bmesh
import bpy
import numpy as np

from renderformer_v2.model.pictures import resize
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE

from .meshes import apply_modifiers
from .own_files import OWN_FILES
from .textures import make_panorama, mean_radiance

LARGEST_MAP = 1024  # pixels
SAME_PLACE = 1e-5   # of a mesh's size: vertices closer than this are one
OWN = "own"         # property of images that are removed with their scene
KINDS = ("objects", "meshes", "materials", "images", "armatures", "actions", "cameras", "lights", "textures",
         "node_groups", "curves", "collections", "worlds")
IMPORTERS = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path),
    ".stl": lambda path: bpy.ops.wm.stl_import(filepath=path),
    ".fbx": lambda path: bpy.ops.wm.fbx_import(filepath=path),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
}


def load_panorama(path: Path, order: str) -> tuple[bpy.types.Image, float] | None:
    """The map in the size of a RenderScene, its channels in `order`, and the factor that makes its mean radiance 1.

    None when it cannot be read, or is black.
    """
    source = _load_image(path)
    if source is None:
        return None
    width, height = source.size
    pixels = np.empty(width * height * source.channels, np.float32)
    source.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, source.channels)
    pixels = pixels[..., [0] * 3 if source.channels < 3 else ["RGB".index(c) for c in order]]
    pixels = resize(np.nan_to_num(pixels, posinf=0.0, neginf=0.0).clip(0), *ENVIRONMENT_SHAPE[:2])
    name = source.colorspace_settings.name
    bpy.data.images.remove(source)
    mean = mean_radiance(pixels)
    if not mean > 0:
        return OWN_FILES.leave_out(path, "it is black")
    image = make_panorama(path.stem, pixels, name)
    image[OWN] = True
    return image, 1.0 / mean


def load_mesh(path: Path) -> bpy.types.Mesh | None:
    """All surfaces of a file as one mesh, with nothing else of the file left.

    Files store a vertex again for each normal and UV, so vertices in the same place are merged. None when there are no
    surfaces, or when they are not watertight (an edge does not have two faces) and have to be.
    """
    before, joined = {kind: set(getattr(bpy.data, kind)) for kind in KINDS}, bmesh.new()
    try:
        IMPORTERS.get(path.suffix.lower(), lambda path: bpy.ops.wm.usd_import(filepath=path))(str(path))
        bpy.context.view_layer.update()
        for imported in set(bpy.data.objects) - before["objects"]:
            if imported.type == "MESH":
                part = apply_modifiers(imported)
                part.transform(imported.matrix_world)
                joined.from_mesh(part)
    except RuntimeError as error:  # what Blender's operators raise
        return OWN_FILES.leave_out(path, str(error).strip())
    finally:
        bpy.data.batch_remove([block for kind in KINDS for block in set(getattr(bpy.data, kind)) - before[kind]])
    points = np.array([vertex.co for vertex in joined.verts])
    if not joined.faces or not np.isfinite(points).all() or not np.ptp(points):
        return OWN_FILES.leave_out(path, "it has no surfaces")
    bmesh.ops.remove_doubles(joined, verts=joined.verts, dist=SAME_PLACE * np.ptp(points, axis=0).max())
    open_edges = sum(not edge.is_manifold for edge in joined.edges)
    if open_edges and not OWN_FILES.open_meshes:
        return OWN_FILES.leave_out(path, f"it is not watertight, {open_edges} of its {len(joined.edges)} edges do not "
                                         "have two faces: close it, or add --open-meshes")
    for face in joined.faces:
        face.material_index = 0
    result = bpy.data.meshes.new(path.stem)
    joined.to_mesh(result)
    joined.free()
    return result


def load_maps(files: dict[str, Path]) -> dict[str, bpy.types.Image] | None:
    """The images of a set, at most LARGEST_MAP wide; None when the base colour cannot be read."""
    images = {kind: _load_image(path) for kind, path in files.items()}
    for kind, image in images.items():
        if image is None:
            continue
        if kind != "base":
            image.colorspace_settings.name = "Non-Color"
        elif not image.is_float:
            image.colorspace_settings.name = "sRGB"
        if max(image.size) > LARGEST_MAP:
            image.scale(*(max(1, size * LARGEST_MAP // max(image.size)) for size in tuple(image.size)))
    return None if images["base"] is None else {kind: image for kind, image in images.items() if image}


def _load_image(path: Path) -> bpy.types.Image | None:
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        return OWN_FILES.leave_out(path, str(error).strip())
    image[OWN] = True
    if not min(image.size):  # Blender reads the file only now
        bpy.data.images.remove(image)
        return OWN_FILES.leave_out(path, "it is no picture")
    return image
