# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects: Blender's primitives, Suzanne and text under random modifiers (docs/scene-input.md 1.2), or the user's."""
from __future__ import annotations

import bmesh
import bpy
import numpy as np

from mathutils import Euler

from . import own, own_data
from .mesh import box_uv, coordinates, evaluated_mesh, fit, shading, subdivided
from .templates import Room

SHAPES = ("cube", "uv_sphere", "ico_sphere", "torus", "cone", "cylinder", "monkey", "text")
DIAMETER = {1: (0.6, 1.0), 2: (0.45, 0.75), 3: (0.4, 0.65), 4: (0.35, 0.55)}  # by object count
SMALL = 0.2, 0.45  # when there are more


def build_objects(rng: np.random.Generator, room: Room, count: int, triangle_limit: int = 1800, *,
                  fill: bool = False) -> list[bpy.types.Object]:
    """`count` objects in the room, so many triangles together; most rest on the floor, few overlap."""
    spheres: list[tuple[np.ndarray, float]] = []
    return [place(rng, room, build_object(rng, f"object {i}", triangle_limit // count, fill=fill), count, spheres)
            for i in range(count)]


def build_object(rng: np.random.Generator, name: str, triangle_limit: int, *, fill: bool = False) -> bpy.types.Object:
    """A mesh object about the origin whose farthest vertex is 0.5 away; modifiers are applied, UVs are boxes.

    With `fill` it is subdivided until it has about as many triangles as it may.
    """
    path = own.current.chosen(rng, "meshes")
    found = own_data.mesh(path) if path else None
    shape = "own" if found else str(rng.choice(SHAPES))
    source = text_object(rng) if shape == "text" else bpy.data.objects.new(name, found or primitive(rng, shape))
    bpy.context.scene.collection.objects.link(source)
    if shape not in ("text", "own"):
        add_modifiers(rng, source, shape)
    mesh = evaluated_mesh(source)
    triangles = sum(len(p.vertices) - 2 for p in mesh.polygons)
    if triangles > triangle_limit:
        if source.type != "MESH":  # modifiers of a text cannot decimate
            bpy.data.objects.remove(source)
            source = bpy.data.objects.new(name, mesh)
            bpy.context.scene.collection.objects.link(source)
        source.modifiers.new("budget", "DECIMATE").ratio = triangle_limit / triangles
        mesh = evaluated_mesh(source)
    bpy.data.objects.remove(source)
    levels = int(np.log(triangle_limit / triangles) / np.log(4)) if fill else 0
    if levels > 0:
        mesh = subdivided(rng, mesh, levels)
    fit(rng, mesh)
    box_uv(mesh)
    shading(rng, mesh)
    result = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(result)
    return result


def primitive(rng: np.random.Generator, shape: str) -> bpy.types.Mesh:
    mesh, bm = bpy.data.meshes.new(shape), bmesh.new()
    if shape == "cube":
        bmesh.ops.create_cube(bm, size=1.0)
    elif shape == "uv_sphere":
        bmesh.ops.create_uvsphere(bm, u_segments=int(rng.integers(8, 25)), v_segments=int(rng.integers(6, 15)),
                                  radius=0.5)
    elif shape == "ico_sphere":
        bmesh.ops.create_icosphere(bm, subdivisions=int(rng.integers(1, 4)), radius=0.5)
    elif shape == "monkey":
        bmesh.ops.create_monkey(bm)
    elif shape == "torus":
        torus(bm, int(rng.integers(10, 25)), int(rng.integers(6, 13)), rng.uniform(0.1, 0.24))
    else:
        sides = int(rng.integers(3, 25))
        top = 0.5 if shape == "cylinder" else rng.uniform(0.0, 0.3)
        bmesh.ops.create_cone(bm, cap_ends=True, cap_tris=True, segments=sides, radius1=0.5, radius2=top,
                              depth=rng.uniform(0.3, 1.2))
    bm.to_mesh(mesh)
    bm.free()
    return mesh


def torus(bm: bmesh.types.BMesh, major: int, minor: int, thickness: float) -> None:
    a = np.linspace(0, 2 * np.pi, major, endpoint=False)[:, None]
    b = np.linspace(0, 2 * np.pi, minor, endpoint=False)[None]
    radius = 0.5 - thickness + thickness * np.cos(b)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), thickness * np.sin(b) + 0 * a], -1)
    vertices = [[bm.verts.new(p) for p in ring] for ring in points]
    for i in range(major):
        for j in range(minor):
            k, m = (i + 1) % major, (j + 1) % minor
            bm.faces.new((vertices[i][j], vertices[k][j], vertices[k][m], vertices[i][m]))


def text_object(rng: np.random.Generator) -> bpy.types.Object:
    curve = bpy.data.curves.new("text", "FONT")
    curve.body = "".join(rng.choice(list("ABCDEFGHJKLMNPRSTUVXYZ23456789&?"), size=int(rng.integers(1, 4))))
    curve.extrude, curve.resolution_u = rng.uniform(0.05, 0.3), 2
    if rng.uniform() < 0.3:
        curve.bevel_depth, curve.bevel_resolution = 0.02, 0
    return bpy.data.objects.new("text", curve)


def add_modifiers(rng: np.random.Generator, source: bpy.types.Object, shape: str) -> None:
    """None to three modifiers; subdivision first where a deformation needs vertices to move."""
    chance = rng.uniform(size=5)
    coarse = len(source.data.vertices) < 40
    if shape in ("cube", "cylinder", "cone") and chance[0] < 0.4:
        bevel = source.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = rng.uniform(0.02, 0.15), int(rng.integers(1, 4))
    deform = chance[1] < 0.35
    if coarse and (deform or chance[2] < 0.3):
        subdivision = source.modifiers.new("subdivision", "SUBSURF")
        subdivision.levels = subdivision.render_levels = 2
        subdivision.subdivision_type = str(rng.choice(["SIMPLE", "CATMULL_CLARK"]))
    if deform and chance[3] < 0.5:
        bend = source.modifiers.new("deform", "SIMPLE_DEFORM")
        bend.deform_method = str(rng.choice(["TWIST", "TAPER", "BEND"]))
        bend.deform_axis = str(rng.choice(["X", "Y", "Z"]))
        bend.factor = rng.uniform(0.5, 1.8) * rng.choice([-1, 1])
    elif deform:
        texture = bpy.data.textures.new("bumps", str(rng.choice(["CLOUDS", "VORONOI", "MUSGRAVE", "STUCCI"])))
        texture.noise_scale = rng.uniform(0.15, 0.6)
        displace = source.modifiers.new("displace", "DISPLACE")
        displace.texture, displace.strength = texture, rng.uniform(0.1, 0.45)
    if chance[4] < 0.1 and shape != "monkey":
        array = source.modifiers.new("array", "ARRAY")
        array.count = int(rng.integers(2, 5))
        array.relative_offset_displace = rng.uniform(0.6, 1.4) * np.roll((1.0, 0.0, 0.0), rng.integers(3))


def place(rng: np.random.Generator, room: Room, result: bpy.types.Object, count: int,
          spheres: list) -> bpy.types.Object:
    """Scale, turn and move an object; `spheres` (centre, radius) of the others are avoided when that is possible."""
    diameter = rng.uniform(*DIAMETER.get(count, SMALL))
    upright = rng.uniform() < 0.6
    result.rotation_euler = (0, 0, rng.uniform(-np.pi, np.pi)) if upright else rng.uniform(-np.pi, np.pi, 3)
    result.scale = [diameter] * 3
    turned = coordinates(result.data) @ np.array(Euler(result.rotation_euler).to_matrix()).T * diameter
    low, high = turned[:, 2].min(), turned[:, 2].max()
    resting, reach = rng.uniform() < 0.75, max(0.0, min(0.5, room.half) - 0.4 * diameter)
    for _ in range(20):
        centre = np.array([*rng.uniform(-reach, reach, 2), room.floor - low])
        if not resting:
            centre[2] += rng.uniform(0, max(0.05, min(room.height, 1.0) - (high - low)))
        if all(np.linalg.norm(centre - c) > 0.8 * (diameter / 2 + r) for c, r in spheres):
            break
    spheres.append((centre, diameter / 2))
    result.location = centre
    return result
