# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.render` for H5 scenes of the research code: render one, or write one from the open .blend file."""
from __future__ import annotations

import time
from pathlib import Path

from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.weights.presets import BUNDLED
from tools.common.tone_mapping import STANDARD
from tools.h5.pictures import save_picture


def render(path: Path, weights: str | None, outputs: list[Path], resolution: tuple[int, int] | None,
           device: str = "auto", precision: str = "auto", tone_mapper: str = STANDARD) -> dict:
    """Every view of the file as linear EXR or tone mapped PNG in folders that exist; what `tools.render` prints.

    Raises SceneError for the scene, CheckpointError for the weights or a picture that is not finite, ValueError for a
    resolution that is not square, OSError as the disk does.
    """
    from renderformer_v2.model.published.h5 import read_h5
    from renderformer_v2.model.renderer import Renderer

    _require_bundle(weights)
    width, height = resolution or (512, 512)
    if width != height:
        raise ValueError(f"H5 scenes are rendered square, not {width}x{height}")
    begin = time.perf_counter()
    renderer, scene = Renderer(weights, device, precision), read_h5(path)
    try:
        images = renderer.render(scene, resolution=width)
    except (SceneError, CheckpointError) as error:
        raise type(error)(f"{path}: {error}") from error
    seconds = time.perf_counter() - begin
    paths = [_number(output, i, len(images)) for output in outputs for i in range(len(images))]
    for path_of_one, image in zip(paths, images * len(outputs), strict=True):
        save_picture(path_of_one, image, tone_mapper)
    return {"scene": str(path), "seconds": {"total": round(seconds, 3)}, "triangles": len(scene.triangles),
            "size": (width, height), "weights": weights, "output": list(map(str, paths))}


def export(scene, weights: str | None, path: Path) -> dict:
    """Write the open file's `scene` (bpy), as F12 would show one of its view layers, into a folder that exists.

    Raises CheckpointError, ValueError or RuntimeError with a message for the user, and OSError as the disk does.
    """
    from renderformer_v2.rf2_engine.convert.data.report import Report
    from renderformer_v2.rf2_engine.paper_scenes.h5_scene import export_h5
    report, begin = Report(), time.perf_counter()
    converted = export_h5(scene, weights, path, report)
    return {"scene": scene.name, "seconds": {"total": round(time.perf_counter() - begin, 3)},
            "triangles": len(converted), "report": report.lines(), "output": [str(path)]}


def _require_bundle(weights: str | None) -> None:
    if weights in (None, BUNDLED):
        raise CheckpointError("H5 scenes hold latents of the published weights: give their folder with --weights")


def _number(path: Path, index: int, count: int) -> Path:
    return path if count == 1 else path.with_name(f"{path.stem}_{index:03d}{path.suffix}")
