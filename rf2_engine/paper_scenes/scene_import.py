# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of the research code in any of its forms, as Blender scenes."""
from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import bpy

from ...model.published.prepared_frame import CONFIG
from ...model.published.v1_scene import convert_v1_scene
from ..convert.data.report import Report
from . import frame_import, h5_scene

H5 = (".h5", ".hdf5")


def import_scene(path: Path, report: Report, resolution: int = frame_import.RESOLUTION) -> bpy.types.Scene:
    """A new scene beside those of the open file, of a prepared frame (its folder, or the scene_config.json in it), an
    H5 scene, or the JSON file of a scene of version 1. What is left out is in the report.

    Raises SceneError for what is none of these; OSError as the disk does.
    """
    if path.suffix.lower() in H5:
        return h5_scene.import_h5(path, report, resolution)
    if path.is_dir() or path.name == CONFIG:
        return frame_import.import_frame(path if path.is_dir() else path.parent, report, resolution)
    with TemporaryDirectory() as folder:
        for remark in convert_v1_scene(path, Path(folder)):
            report.approximated(path.stem, remark)
        scene = frame_import.import_frame(Path(folder), report, resolution)
        for image in bpy.data.images:
            if Path(folder).resolve() in Path(image.filepath).parents:
                image.pack()
    return scene
