# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that others made, ready to render: the files of docs/measured.md 10, with what they lack.

    python examples/others.py FOLDER OUT_DIR [NAME ...]      # OUT_DIR/apartment.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR --reference 256

FOLDER holds the packages, unpacked. Every file gets a size; a camera, where it has none or one that sees little; and
what the table below says. The compositor is off, and Cycles denoises. Nothing else is changed.
"""
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from room import choose_engine, look  # noqa: E402

BALL = "datafiles/preview.blend"
LIBRARY = "materials_library_vx/sample_materials.blend"
MATERIALS = ("Basic Glass", "Brushed Metal", "Car Paint", "Jewelry", "Molten", "Polished Walnut", "Galvanized Steel",
             "Chocolate Swirl")


class Others(NamedTuple):
    """A file of a package. camera: (place, what it looks at, lens in mm); frame: of its animation."""

    file: str
    size: tuple[int, int] = (384, 256)
    camera: tuple[tuple, tuple, float] | None = None
    frame: int | None = None
    change: Callable[[Path], None] | None = None


def shader_ball(_folder):
    """Of the shapes that Blender's previews have, all but the shader ball are left out."""
    _show({"Env", "Shader Ball"})


def materials(folder):
    """Eight spheres with materials of the library on the floor of Blender's previews."""
    _show({"Env"})
    bpy.context.scene.collection.children.link(bpy.data.collections["Env"])  # which is in those that are hidden
    with bpy.data.libraries.load(str(find(folder, LIBRARY))) as (_, appended):
        appended.materials = list(MATERIALS)
    for index, of in enumerate(appended.materials):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=0.1, location=(
            -0.4 + index // 4 * 0.3, -0.36 + index % 4 * 0.24, 0.1))
        bpy.ops.object.shade_smooth()
        bpy.context.object.data.materials.append(of)


def skeleton(folder):
    """The skeleton of FreeMoCap in the studio of Molecular Nodes."""
    with bpy.data.libraries.load(str(find(folder, "assets/skelly_full_mesh_20k_faces.blend"))) as (there, appended):
        appended.objects = there.objects
    for thing in appended.objects:
        bpy.context.scene.collection.objects.link(thing)


def without_sky_ball(_folder):
    """The ball with a picture of the sky was for a game engine: it keeps the sun out."""
    bpy.data.objects["SkyBox"].hide_render = True


def _show(collections):
    for collection in bpy.context.scene.collection.children_recursive:
        collection.hide_render = collection.name not in collections


SCENES = {
    "apartment": Others("environments/apartment.blend", camera=((-1.9, 2.1, 1.6), (-4.6, -1.0, 0.5), 24)),
    "ball": Others(BALL, (256, 256), change=shader_ball),
    "character": Others("robots/human_rig.blend", (256, 384), camera=((1.9, 1.4, 1.3), (0.05, 0, 0.85), 35)),
    "clapboard": Others("openshot_qt/blender/blend/zoom_clapboard.blend", frame=100),
    "earth": Others("openshot_qt/blender/blend/earth.blend", frame=150),
    "kitchen": Others("tum_kitchen/tum_kitchen.blend", camera=((6.2, -0.4, 1.8), (0.5, 2.2, 0.8), 24)),
    "materials": Others(BALL, camera=((1.4, 0, 0.95), (-0.25, 0, 0.06), 60), change=materials),
    "neon": Others("openshot_qt/blender/blend/neon_curves.blend", frame=100),
    "sandbox": Others("environments/sandbox.blend"),
    "skeleton": Others("molecularnodes/assets/template/startup.blend", (256, 384),
                       camera=((1.6, -4.6, 1.5), (0, 0, 0.85), 50), change=skeleton),
    "streets": Others("land-1/buildings_2.blend", camera=((-7, -14, 3), (8, -2, 2.5), 28), change=without_sky_ball),
    "tableware": Others("props/kitchen_objects.blend", camera=((0.5, -1.0, 0.75), (0.05, 0.12, 0), 35)),
    "town": Others("land-1/rosace_1.blend", camera=((-50, -55, 35), (5, 0, 3), 30)),
}


def find(folder: Path, file: str) -> Path:
    """The one file of this name below `folder`. Raises FileNotFoundError."""
    for path in sorted(folder.rglob(Path(file).name)):
        if path.as_posix().endswith(f"/{file}"):
            return path
    raise FileNotFoundError(f"there is no {file} below {folder}: unpack the package that has it (docs/measured.md 10)")


def prepare(folder: Path, name: str, output: Path):
    """Write output/NAME.blend. Raises FileNotFoundError."""
    of = SCENES[name]
    bpy.ops.wm.open_mainfile(filepath=str(find(folder, of.file)), load_ui=False)
    if of.change:
        of.change(folder)
    scene = bpy.context.scene
    if of.frame is not None:
        scene.frame_set(of.frame)
    if of.camera:
        look("Added Camera", *of.camera)
    render = scene.render
    render.resolution_x, render.resolution_y = of.size
    render.resolution_percentage, render.use_border, render.use_compositing = 100, False, False
    scene.cycles.use_denoising = True
    choose_engine()
    bpy.ops.wm.save_as_mainfile(filepath=str(output.resolve() / f"{name}.blend"), compress=True)


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:3])
    target.mkdir(parents=True, exist_ok=True)
    for chosen in sys.argv[3:] or SCENES:
        prepare(source, chosen, target)
    sys.stdout.flush()
    os._exit(0)
