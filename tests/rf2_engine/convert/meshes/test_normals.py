# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading normals of the token triangles against Cycles' Normal pass."""
import bpy
import numpy as np
import OpenEXR

from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import cast_guides
from bl_ext.user_default.renderformer_v2.model.geometry import area_vectors, facing, reflected
from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera

SIZE = 128


def flat():
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2)


def smooth():
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.object.shade_smooth()


def auto_smooth():
    bpy.ops.mesh.primitive_cylinder_add(vertices=12)
    bpy.ops.object.shade_auto_smooth(angle=np.radians(40))


def custom():
    bpy.ops.mesh.primitive_cube_add()
    mesh = bpy.context.object.data
    bpy.ops.object.shade_smooth()
    mesh.normals_split_custom_set([np.float32(mesh.vertices[loop.vertex_index].co) + (0, 0.5, -0.3)
                                   for loop in mesh.loops])


def weighted():
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.shade_smooth()
    bevel = bpy.context.object.modifiers.new("bevel", "BEVEL")
    bevel.width, bevel.segments = 0.3, 2
    bpy.context.object.modifiers.new("weighted", "WEIGHTED_NORMAL").keep_sharp = True


def mirrored():
    smooth()
    bpy.context.object.scale = (-1, 1, 1)


def stretched():
    smooth()
    bpy.context.object.scale = (0.4, 1.2, 0.9)
    bpy.context.object.rotation_euler = (0.4, 0.8, 0.2)


def instanced():
    """A collection instance that is stretched askew, of a mesh that is itself turned and stretched."""
    stretched()
    collection, obj = bpy.data.collections.new("source"), bpy.context.object
    collection.objects.link(obj)
    bpy.context.scene.collection.objects.unlink(obj)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.scale, empty.rotation_euler = (-1.3, 0.6, 1), (0.3, 0.2, 1)
    bpy.context.scene.collection.objects.link(empty)
    bpy.context.view_layer.objects.active = empty


def test_normals_are_those_of_cycles(scene, converted, tmp_path):
    kinds = (flat, smooth, auto_smooth, custom, weighted, mirrored, stretched, instanced)
    for i, kind in enumerate(kinds):
        kind()
        bpy.context.view_layer.objects.active.location = (3 * (i % 4) - 4.5, 0, 3 * (i // 4) - 1.5)
    scene.camera.location, scene.camera.data.type = (0, -60, 0), "PERSP"
    scene.camera.data.angle = 2 * np.arctan(6.5 / 60)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    expected = cycles_normals(scene, tmp_path)
    tokens = converted()
    guides = cast_guides(tokens, convert_camera(bpy.context.evaluated_depsgraph_get(), SIZE, SIZE, None))
    apart = np.degrees(np.arccos(np.clip((guides.normal * expected).sum(axis=-1), -1, 1)))
    length = np.linalg.norm(expected, axis=-1)
    inside = (guides.alpha > 0) & (np.abs(length - 1) < 1e-3) & ~mirrored_into_the_surface(tokens, guides, scene)
    for i, kind in enumerate(kinds):
        column, row = i % 4, i // 4
        tile = np.s_[SIZE // 2 * (1 - row):SIZE // 2 * (2 - row), SIZE // 4 * column:SIZE // 4 * (column + 1)]
        errors = apart[tile][inside[tile]]
        assert len(errors) > 80, kind.__name__
        away = errors > 90  # custom normals may point away from the viewer, to whom guides turn them
        assert away.mean() < 0.1, kind.__name__
        errors = np.minimum(errors, 180 - errors)
        assert np.median(errors) < 0.1 and np.percentile(errors, 97) < 2, (kind.__name__, np.percentile(errors, 97))


def mirrored_into_the_surface(tokens, guides, scene) -> np.ndarray:
    """(H, W) where Cycles of Blender 5 bends a smooth normal, so that what it mirrors lies above the surface."""
    rays = guides.position - np.array(scene.camera.location)
    mirrored = reflected(rays, facing(guides.normal, rays))
    return (mirrored * facing(area_vectors(tokens.triangles[guides.hit_triangle]), rays)).sum(-1) < 0


def cycles_normals(scene, tmp_path) -> np.ndarray:
    """(H, W, 3) one sample in the middle of each pixel, row 0 on top."""
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.cycles.max_bounces, scene.cycles.filter_width = 0, 0.01
    bpy.context.view_layer.use_pass_normal = True
    compat.set_file_format(scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    scene.render.image_settings.color_depth, scene.render.filepath = "32", str(tmp_path / "normals.exr")
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(scene.render.filepath) as file:
        channels = file.channels()
        return np.stack([channels[f"ViewLayer.Normal.{axis}"].pixels for axis in "XYZ"], axis=-1)
