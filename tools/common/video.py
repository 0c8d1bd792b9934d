# SPDX-License-Identifier: GPL-3.0-or-later
"""Videos of pictures, by Blender's own encoder."""
from __future__ import annotations

import os
from pathlib import Path

FRAMES_PER_SECOND = 24


def write_video(path: Path, pictures: list[Path]) -> None:
    """An MP4 (H.264) of PNG files of one size, in this order. Raises OSError naming `path`."""
    import bpy

    from renderformer_v2.rf2_engine.compat import add_image_strip, set_video_format
    scene = bpy.data.scenes.new("Video")
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        scene.sequence_editor_create()
        size = add_image_strip(scene, list(map(str, pictures)))
        scene.frame_start, scene.frame_end = 1, len(pictures)
        render = scene.render
        render.fps, render.resolution_percentage = FRAMES_PER_SECOND, 100
        # H.264 halves the resolution of colour, so sides are even.
        render.resolution_x, render.resolution_y = (side + side % 2 for side in size)
        scene.view_settings.view_transform = "Standard"
        set_video_format(render)
        render.filepath, render.use_compositing, render.use_sequencer = str(temporary), False, True
        bpy.ops.render.render(animation=True, scene=scene.name)
        os.replace(temporary, path)
    except (RuntimeError, OSError) as error:
        raise OSError(f"{path} cannot be written: {getattr(error, 'strerror', None) or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
        bpy.data.scenes.remove(scene)
