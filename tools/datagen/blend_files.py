# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of the user's own .blend files: their cameras at their frames, and cameras moved a little from there.

The file keeps its world, lights, materials and Cycles' light paths. Pictures are square, as all training pictures, and
without depth of field and motion blur, which the network does not know. Nothing is ever saved to the file.
"""
from __future__ import annotations

import hashlib
import sys
import time
from pathlib import Path

import bpy
import numpy as np

from mathutils import Matrix, Vector

from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.scene import TILE_SIZE
from tools.common.console import to_one_line
from tools.common.scene_file import open_scene

from . import render_sample
from .sample_files import SampleCounts, save_sample
from .scenes.cameras import Setup

TOGETHER = 2  # views of a sample at most: training holds all of them in memory at once

# Cameras beside the user's, turned around what that looks at.
AZIMUTH, ELEVATION = np.radians((15.0, 8.0))  # most, to either side
NEARNESS = 0.85, 1.15                         # distance to the target, relative to before
TRIES = 8                                     # each smaller than the one before
CLEAR = 0.5                                   # of the distance to the target must be free


def generate(out: Path, files: list[Path], counts: SampleCounts, *, views: int, threads: int, resolution: int) -> int:
    """Make the samples that are missing in `out`, `views` views of each file. Returns how many files failed.

    resolution: pixels, both sides.
    A file that cannot be used is named on stderr, with what to do.
    Raises OSError when `out` cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    bpy.utils.register_class(render_sample.DatagenEngine)
    failed = 0
    for file in files:
        try:
            if not file.is_file():
                raise SceneError("there is no such file")
            make_samples(out, file, counts, views, threads, resolution)
        except (SceneError, RuntimeError, ValueError) as error:  # Blender raises RuntimeError for what it cannot read
            print(f"{file}: {to_one_line(error)}", file=sys.stderr)
            failed += 1
    return failed


def make_samples(out: Path, file: Path, counts: SampleCounts, views: int, threads: int, resolution: int) -> None:
    """The samples of one file that are not in `out` yet. Raises SceneError, and RuntimeError as Blender does."""
    paths = [sample_path(out, file, i) for i in range(-(-views // TOGETHER))]
    missing = [i for i, path in enumerate(paths) if not is_current(path, file)]
    if not missing:
        return
    scene = open_scene(file)
    prepare(scene, threads)
    frames = spread_frames(scene, len(paths))
    shots = [(frame, camera_at(scene, frame)) for frame in frames]
    for marker in scene.timeline_markers:  # they would put the user's camera in place of ours
        marker.camera = None
    for i in missing:
        begin = time.perf_counter()
        frame, camera = shots[i]
        scene.frame_set(frame)
        count = min(TOGETHER, views - i * TOGETHER)
        cameras = build_cameras(scene, camera, count, frame not in frames[:i], np.random.default_rng(i))
        sample = render_sample.make_sample(Setup(cameras, resolution=resolution), counts, lambda passes: True)
        save_sample(paths[i], sample.scene, sample.views, sample.guides, sample.passes, tile_size=TILE_SIZE,
                    hints=counts.hints)
        for added in cameras:
            bpy.data.cameras.remove(added.data)
        print(f"{paths[i].name}: {file.name}, frame {frame}, {count} views, {len(sample.scene)} triangles, "
              f"{time.perf_counter() - begin:.1f} s", *sample.report.lines(), sep="\n  ")


def sample_path(out: Path, file: Path, index: int) -> Path:
    folder_hash = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:8]  # two folders may hold files of one name
    return out / f"scene_{file.stem}_{folder_hash}_{index:03d}.npz"


def is_current(path: Path, file: Path) -> bool:
    """Whether the sample is there and no older than the file."""
    return path.is_file() and path.stat().st_mtime >= file.stat().st_mtime


def prepare(scene: bpy.types.Scene, threads: int) -> None:
    """One square picture of the first enabled view layer, straight from the renderer."""
    render_sample.take_over(scene.render, threads)
    for name in ("use_border", "use_multiview", "use_compositing", "use_sequencer", "use_motion_blur"):
        setattr(scene.render, name, False)
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1
    first = next(layer for layer in scene.view_layers if layer.use)
    for layer in scene.view_layers:
        layer.use = layer == first


def spread_frames(scene: bpy.types.Scene, count: int) -> list[int]:
    """`count` frames: spread over the frame range, or the current one again and again where nothing is animated."""
    if not bpy.data.actions:
        return [scene.frame_current] * count
    steps = (np.arange(count) + 0.5) / count * (scene.frame_end - scene.frame_start + 1)
    return [scene.frame_start + int(step) for step in steps]


def camera_at(scene: bpy.types.Scene, frame: int) -> bpy.types.Object:
    scene.frame_set(frame)
    if scene.camera is None or scene.camera.type != "CAMERA":
        raise SceneError(f'scene "{scene.name}" has no camera at frame {frame}: add one and make it active')
    return scene.camera


def build_cameras(scene: bpy.types.Scene, camera: bpy.types.Object, count: int, with_original: bool,
                  rng: np.random.Generator) -> list[bpy.types.Object]:
    """Copies of `camera` at the scene's frame, moved a little; `with_original` the first one is where it is."""
    depsgraph, poses = bpy.context.evaluated_depsgraph_get(), []
    for i in range(count):
        poses.append(camera.matrix_world.copy() if with_original and not i else
                     move_pose(rng, scene, depsgraph, camera.matrix_world))
    return [add_copy(scene, camera, pose) for pose in poses]


def add_copy(scene: bpy.types.Scene, camera: bpy.types.Object, pose) -> bpy.types.Object:
    """A copy of the camera without parent, constraints and animation, which would move it back."""
    copy = bpy.data.objects.new(camera.name, camera.data.copy())
    copy.matrix_world = pose
    copy.data.dof.use_dof = False
    scene.collection.objects.link(copy)
    return copy


def move_pose(rng: np.random.Generator, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph,
              pose: Matrix) -> Matrix:
    """A camera-to-world near `pose` on the same side of all walls; where there is no room it is only turned.

    A camera that looks at nothing is turned in its place, too.
    """
    eye, forward = pose.translation, -pose.col[2].to_3d().normalized()
    distance = free_distance(scene, depsgraph, eye, forward)
    for size in np.linspace(1, 1 / TRIES, TRIES):
        azimuth, elevation = size * rng.uniform(-1, 1, 2) * (AZIMUTH, ELEVATION)
        turn = Matrix.Rotation(azimuth, 4, "Z") @ Matrix.Rotation(elevation, 4, pose.col[0].to_3d().normalized())
        if not np.isfinite(distance):
            break
        pivot = eye + distance * forward
        moved = Matrix.Translation(pivot) @ turn @ Matrix.Translation(-pivot) @ pose
        moved.translation = pivot + (moved.translation - pivot) * (1 + size * (rng.uniform(*NEARNESS) - 1))
        step = moved.translation - eye
        if (free_distance(scene, depsgraph, eye, step) > 2 * step.length
                and free_distance(scene, depsgraph, moved.translation, pivot - moved.translation) > CLEAR * distance):
            return moved
    return Matrix.Translation(eye) @ turn @ Matrix.Translation(-eye) @ pose


def free_distance(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Vector, direction: Vector) -> float:
    """How far it is to the first surface, in metres; infinity where there is none."""
    is_hit, position, *_ = scene.ray_cast(depsgraph, start, direction.normalized())
    return (position - start).length if is_hit else np.inf
