# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a scene whose camera turns about what it looks at: render those that are missing, read them, show them."""
from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Iterable, Iterator
from math import radians
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

from mathutils import Matrix, Vector

from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.scene import View
from renderformer_v2.model.weights.presets import weights_folder
from tools.common.pictures import read_pass, to_bytes, write_atomically
from tools.common.scene_file import RenderOptions, configure, open_scene, save_picture

from .measure import Frame

FILM_SECONDS = 0.125  # of a frame
FILM_QUALITY = 95     # of 100


def render_frames(path: Path, output: Path, engine: str, frames: int, degrees: float,
                  **settings) -> list[tuple[View, Path]]:
    """(View, file) of every frame; those that `output` holds already are not rendered again.

    settings: of RenderOptions. Frames with other settings have another folder in `output`; the
    seconds of every frame are printed. Raises what Blender raises, SceneError when there is no usable camera, and
    OSError.
    """
    scene = open_scene(path)
    configure(scene, RenderOptions(engine, **settings))
    scene.render.use_border = False
    for layer in scene.view_layers:
        layer.use_pass_position = True
    settings |= {"threads": None, "engine": engine, "frames": frames, "degrees": degrees, "scene": _digest(path)}
    if engine == "renderformer":
        weights = weights_folder(scene.renderformer_v2.weights())
        settings["weights"] = [_digest(file) for file in sorted(weights.glob("*.safetensors"))]
    text = json.dumps(settings, indent=1, sort_keys=True)
    folder = output / f"{engine}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "settings.json").write_text(text)
    rendered = []
    for number, view in enumerate(step_frames(scene, frames, degrees), 1):
        file = folder / f"{number:04d}.exr"
        if not file.exists():
            begin = time.perf_counter()
            bpy.ops.render.render(scene=scene.name)
            print(f"{file}: {time.perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)
            save_picture(file, scene)
        rendered.append((view, file))
    return rendered


def read_frame(view: View, file: Path) -> Frame:
    return Frame(view, read_pass(file, "Combined", "RGB"), read_pass(file, "Position", "XYZ"))


def step_frames(scene: bpy.types.Scene, frames: int, degrees: float) -> Iterator[View]:
    """Set the scene to one frame after the other, from its first one, and yield the camera's View.

    The camera turns by `degrees` a frame about a vertical axis, with the pose that the file is saved in in the
    middle; with 0 degrees it is animated as in the file. Raises SceneError when there is no usable camera.
    """
    from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera

    if degrees and scene.camera:
        _animate_camera(scene, [radians(degrees) * (index - (frames - 1) / 2) for index in range(frames)])
    for index in range(frames):
        scene.frame_set(scene.frame_start + index)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        scale = scene.render.resolution_percentage / 100
        yield convert_camera(depsgraph, int(scene.render.resolution_x * scale), int(scene.render.resolution_y * scale),
                             None)


def write_film(path: Path, frames: Iterable[Iterable[np.ndarray]]) -> None:
    """An animated .webp of frames, each of which is pictures (H, W, 3) f32, linear, shown side by side.

    Raises OSError naming `path`.
    """
    images = [Image.fromarray(np.hstack([to_bytes(linear_to_srgb(picture)) for picture in pictures]))
              for pictures in frames]
    write_atomically(path, lambda temporary: images[0].save(
        temporary, save_all=True, append_images=images[1:], duration=round(1000 * FILM_SECONDS), loop=0,
        quality=FILM_QUALITY, method=6))


def _animate_camera(scene: bpy.types.Scene, angles: list[float]) -> None:
    """Key a copy of the camera at these angles: the camera itself may be animated or constrained."""
    pose = scene.camera.matrix_world.copy()
    camera = bpy.data.objects.new("Orbit", scene.camera.data)
    scene.collection.objects.link(camera)
    scene.timeline_markers.clear()  # they may bind other cameras
    scene.camera, camera.rotation_mode = camera, "QUATERNION"
    pivot = Matrix.Translation(_find_target(scene, pose))
    for frame, angle in enumerate(angles, scene.frame_start):
        camera.matrix_world = pivot @ Matrix.Rotation(angle, 4, "Z") @ pivot.inverted() @ pose
        for path in ("location", "rotation_quaternion", "scale"):
            camera.keyframe_insert(path, frame=frame)


def _find_target(scene: bpy.types.Scene, pose: Matrix) -> Vector:
    """The point on the camera's axis that is nearest to the middle of what is rendered, always in front of it."""
    corners = [item.matrix_world @ Vector(corner) for item in scene.objects
               if item.type == "MESH" and not item.hide_render for corner in item.bound_box]
    middle = sum(corners, Vector()) / max(len(corners), 1)
    forward = -pose.col[2].to_3d().normalized()
    size = max(((corner - middle).length for corner in corners), default=1.0)
    return pose.translation + forward * max((middle - pose.translation).dot(forward), 0.1 * size)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
