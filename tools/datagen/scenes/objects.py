# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects: Blender's primitives, Suzanne and text under random modifiers (docs/scene-input.md 1.2), or the user's.

Also flat mirrors, and clear glass before the camera.
"""
from __future__ import annotations

import bmesh
import bpy
import numpy as np

from mathutils import Euler

from . import own_data
from .materials import clear_glass_material, mirror_material
from .meshes import add_object, apply_modifiers, center_and_scale, read_vertices, set_box_uv, set_shading, subdivide
from .own_files import OWN_FILES
from .rooms import Room, add_plane

SHAPES = ("cube", "uv_sphere", "ico_sphere", "torus", "cone", "cylinder", "monkey", "text")
DIAMETER = {1: (0.6, 1.0), 2: (0.45, 0.75), 3: (0.4, 0.65), 4: (0.35, 0.55)}  # by object count
SMALL = 0.2, 0.45  # when there are more


def build_objects(rng: np.random.Generator, room: Room, count: int, triangle_limit: int = 1800, *,
                  fill: bool = False) -> list[bpy.types.Object]:
    """`count` objects in the room, of that many triangles together; most rest on the floor, few overlap."""
    spheres: list[tuple[np.ndarray, float]] = []
    return [place_object(rng, room, build_object(rng, f"object {i}", triangle_limit // count, fill=fill), count,
                         spheres) for i in range(count)]


def build_object(rng: np.random.Generator, name: str, triangle_limit: int, *, fill: bool = False) -> bpy.types.Object:
    """A mesh object about the origin whose farthest vertex is 0.5 away; modifiers are applied, UVs are boxes.

    With `fill` it is subdivided until it has about as many triangles as it may.
    """
    path = OWN_FILES.choose(rng, "meshes")
    own_mesh = own_data.load_mesh(path) if path else None
    shape = "own" if own_mesh else str(rng.choice(SHAPES))
    source = add_object(*(("text", make_text(rng)) if shape == "text" else (name, own_mesh or make_mesh(rng, shape))))
    if shape not in ("text", "own"):
        add_modifiers(rng, source, shape)
    mesh = apply_modifiers(source)
    triangles = sum(len(p.vertices) - 2 for p in mesh.polygons)
    if triangles > triangle_limit:
        if source.type != "MESH":  # modifiers of a text cannot decimate
            bpy.data.objects.remove(source)
            source = add_object(name, mesh)
        source.modifiers.new("budget", "DECIMATE").ratio = triangle_limit / triangles
        mesh = apply_modifiers(source)
    bpy.data.objects.remove(source)
    levels = int(np.log(triangle_limit / triangles) / np.log(4)) if fill else 0
    if levels > 0:
        mesh = subdivide(rng, mesh, levels)
    center_and_scale(rng, mesh)
    set_box_uv(mesh)
    set_shading(rng, mesh)
    return add_object(name, mesh)


def make_mesh(rng: np.random.Generator, shape: str) -> bpy.types.Mesh:
    """One of SHAPES but text, of random proportions."""
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
        add_torus(bm, int(rng.integers(10, 25)), int(rng.integers(6, 13)), rng.uniform(0.1, 0.24))
    else:
        sides = int(rng.integers(3, 25))
        top = 0.5 if shape == "cylinder" else rng.uniform(0.0, 0.3)
        bmesh.ops.create_cone(bm, cap_ends=True, cap_tris=True, segments=sides, radius1=0.5, radius2=top,
                              depth=rng.uniform(0.3, 1.2))
    bm.to_mesh(mesh)
    bm.free()
    return mesh


def add_torus(bm: bmesh.types.BMesh, major: int, minor: int, thickness: float) -> None:
    a = np.linspace(0, 2 * np.pi, major, endpoint=False)[:, None]
    b = np.linspace(0, 2 * np.pi, minor, endpoint=False)[None]
    radius = 0.5 - thickness + thickness * np.cos(b)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), thickness * np.sin(b) + 0 * a], -1)
    vertices = [[bm.verts.new(p) for p in ring] for ring in points]
    for i in range(major):
        for j in range(minor):
            k, m = (i + 1) % major, (j + 1) % minor
            bm.faces.new((vertices[i][j], vertices[k][j], vertices[k][m], vertices[i][m]))


def make_text(rng: np.random.Generator) -> bpy.types.Curve:
    """One to three letters with depth."""
    curve = bpy.data.curves.new("text", "FONT")
    curve.body = "".join(rng.choice(list("ABCDEFGHJKLMNPRSTUVXYZ23456789&?"), size=int(rng.integers(1, 4))))
    curve.extrude, curve.resolution_u = rng.uniform(0.05, 0.3), 2
    if rng.uniform() < 0.3:
        curve.bevel_depth, curve.bevel_resolution = 0.02, 0
    return curve


def add_modifiers(rng: np.random.Generator, source: bpy.types.Object, shape: str) -> None:
    """None to three modifiers; subdivision first where a deformation needs vertices to move."""
    chance = rng.uniform(size=5)
    is_coarse = len(source.data.vertices) < 40
    if shape in ("cube", "cylinder", "cone") and chance[0] < 0.4:
        bevel = source.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = rng.uniform(0.02, 0.15), int(rng.integers(1, 4))
    is_deformed = chance[1] < 0.35
    if is_coarse and (is_deformed or chance[2] < 0.3):
        subdivision = source.modifiers.new("subdivision", "SUBSURF")
        subdivision.levels = subdivision.render_levels = 2
        subdivision.subdivision_type = str(rng.choice(["SIMPLE", "CATMULL_CLARK"]))
    if is_deformed and chance[3] < 0.5:
        bend = source.modifiers.new("deform", "SIMPLE_DEFORM")
        bend.deform_method = str(rng.choice(["TWIST", "TAPER", "BEND"]))
        bend.deform_axis = str(rng.choice(["X", "Y", "Z"]))
        bend.factor = rng.uniform(0.5, 1.8) * rng.choice([-1, 1])
    elif is_deformed:
        texture = bpy.data.textures.new("bumps", str(rng.choice(["CLOUDS", "VORONOI", "MUSGRAVE", "STUCCI"])))
        texture.noise_scale = rng.uniform(0.15, 0.6)
        displace = source.modifiers.new("displace", "DISPLACE")
        displace.texture, displace.strength = texture, rng.uniform(0.1, 0.45)
    if chance[4] < 0.1 and shape != "monkey":
        array = source.modifiers.new("array", "ARRAY")
        array.count = int(rng.integers(2, 5))
        array.relative_offset_displace = rng.uniform(0.6, 1.4) * np.roll((1.0, 0.0, 0.0), rng.integers(3))


def place_object(rng: np.random.Generator, room: Room, placed: bpy.types.Object, count: int,
                 spheres: list[tuple[np.ndarray, float]]) -> bpy.types.Object:
    """Scale, turn and move an object.

    spheres: centres and radii of the others, which are avoided when that is possible; the object's own is added.
    """
    diameter = rng.uniform(*DIAMETER.get(count, SMALL))
    is_upright = rng.uniform() < 0.6
    placed.rotation_euler = (0, 0, rng.uniform(-np.pi, np.pi)) if is_upright else rng.uniform(-np.pi, np.pi, 3)
    placed.scale = [diameter] * 3
    turned = read_vertices(placed.data) @ np.array(Euler(placed.rotation_euler).to_matrix()).T * diameter
    low, high = turned[:, 2].min(), turned[:, 2].max()
    is_resting, reach = rng.uniform() < 0.75, max(0.0, min(0.5, room.half) - 0.4 * diameter)
    for _ in range(20):
        centre = np.array([*rng.uniform(-reach, reach, 2), room.floor - low])
        if not is_resting:
            centre[2] += rng.uniform(0, max(0.05, min(room.height, 1.0) - (high - low)))
        if all(np.linalg.norm(centre - c) > 0.8 * (diameter / 2 + r) for c, r in spheres):
            break
    spheres.append((centre, diameter / 2))
    placed.location = centre
    return placed


def build_mirror(rng: np.random.Generator, room: Room, name: str) -> bpy.types.Object:
    """0.4 to 1.2 wide, upright or leaning a little, behind or beside the objects and turned to them."""
    azimuth = np.pi / 2 + rng.uniform(-1.3, 1.3)
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    distance = rng.uniform(0.5, 0.9) if not room.walls else 0.95 * room.half * rng.uniform(0.8, 1.0)
    right = np.array([away[1], -away[0], 0.0]) * rng.uniform(0.4, 1.2)
    up = (np.array([0, 0, 1.0]) + away * rng.uniform(0, 0.25)) * rng.uniform(0.4, 1.0)
    foot = distance * away + np.array([0, 0, room.floor + rng.uniform(0.01, 0.2)])
    mirror = add_plane(name, rng, foot - right / 2, right, up)
    mirror.data.materials.append(mirror_material(rng))
    return mirror


def build_glass(rng: np.random.Generator, camera: bpy.types.Object, name: str) -> bpy.types.Object:
    """An object of clear glass 35 to 65 % of the way from the origin to the camera, over a part of the picture."""
    glass = build_object(rng, name, 600)
    eye = np.array(camera.location)
    distance, nearness = np.linalg.norm(eye), rng.uniform(0.35, 0.65)
    width = 2 * np.tan(camera.data.angle / 2) * distance * (1 - nearness)  # of the picture there
    diameter = min(width * rng.uniform(0.3, 0.6), 0.8 * distance * (1 - nearness))
    glass.scale = [diameter] * 3
    glass.rotation_euler = rng.uniform(-np.pi, np.pi, 3)
    glass.location = nearness * eye + rng.uniform(-0.2, 0.2, 3) * width
    glass.data.materials.append(clear_glass_material(rng))
    return glass
