# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a Rendered viewport whose view swings around what the camera of a scene looks at.

    python -m tools.orbit SCENE.blend FOLDER [--frames 24] [--size 384x256] [--angle 25] [--budget 4096]

writes FOLDER/0000.png and so on: there and back, so that they can be shown in a loop. Every frame is the finest picture
of a viewport of that size. The scene is converted and encoded once; the seconds of each frame are printed.
"""
from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from . import extension
from .common.viewport import read_camera_pose, request_picture


def main() -> int:
    arguments = _parse_arguments()
    extension.load().register()
    import bpy

    from .common.scene_file import open_scene
    scene = open_scene(arguments.scene)
    scene.render.engine = "RENDERFORMER_V2"
    scene.renderformer_v2.viewport.token_budget = arguments.budget
    scene.renderformer_v2.viewport.time_limit = 0
    depsgraph = bpy.context.evaluated_depsgraph_get()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(_render_frames(scene, depsgraph, arguments)):
        _save(picture.pixels, arguments.folder / f"{number:04}.png", scene)
        print(f"frame {number + 1} of {arguments.frames}: {picture.seconds:.2f} s, {picture.triangles} triangles",
              flush=True)
    return 0


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.orbit", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(384, 256))
    parser.add_argument("--angle", type=float, default=25.0, help="degrees to either side")
    parser.add_argument("--budget", type=int, default=4096, help="triangles")
    return parser.parse_args()


def _render_frames(scene, depsgraph, arguments: argparse.Namespace):
    """The viewport's finest picture of every frame."""
    from renderformer_v2.rf2_engine.viewport.session import Session
    from renderformer_v2.rf2_engine.viewport.source import Source
    source, session = Source(), Session()
    while not source.refresh(depsgraph):
        pass
    pose = read_camera_pose(scene, depsgraph)
    center = _find_target(scene, depsgraph, pose)
    for number in range(arguments.frames):
        angle = math.radians(arguments.angle) * math.sin(2 * math.pi * number / arguments.frames)
        session.submit(request_picture(scene, depsgraph, source, arguments.size, _turn(pose, center, angle)))
        while session.has_work():
            session.step(lambda *_: None)
        if session.error:
            raise RuntimeError(session.error)
        yield session.displayed


def _find_target(scene, depsgraph, pose: np.ndarray) -> np.ndarray:
    """(3,) the surface in the middle of the camera's picture."""
    from mathutils import Vector
    is_hit, position, *_ = scene.ray_cast(depsgraph, Vector(pose[:3, 3]), Vector(-pose[:3, 2]))
    return np.array(position) if is_hit else pose[:3, 3] - 5 * pose[:3, 2]


def _turn(pose: np.ndarray, center: np.ndarray, angle: float) -> np.ndarray:
    """The (4, 4) pose turned about an upright axis through a point."""
    turn = np.eye(4)
    turn[:2, :2] = (math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle))
    turn[:3, 3] = center - turn[:3, :3] @ center
    return turn @ pose


def _save(pixels: np.ndarray, path: Path, scene) -> None:
    """Through the scene's view transform."""
    import bpy

    from renderformer_v2.rf2_engine.compat import set_file_format
    image = bpy.data.images.new("Viewport", pixels.shape[1], pixels.shape[0], float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
    set_file_format(scene.render.image_settings, "PNG")
    image.save_render(str(path), scene=scene)
    bpy.data.images.remove(image)


if __name__ == "__main__":
    extension.run(main)
