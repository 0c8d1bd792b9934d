# SPDX-License-Identifier: GPL-3.0-or-later
"""Export Comparison: write a sheet as PNG, and the numbers as JSON beside it."""
from __future__ import annotations

import json
import tempfile
from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ...model.metrics import flip
from ..registering import classes
from . import comparison, sheet
from .measuring import Measurement


class RENDERFORMER_OT_compare_export(bpy.types.Operator, ExportHelper):
    """Save A, B, their difference and the FLIP map in one PNG file, and the metrics in a JSON file beside it"""
    bl_idname = "renderformer_v2.compare_export"
    bl_label = "Export Comparison"

    filename_ext = ".png"
    filter_glob: bpy.props.StringProperty(default="*.png", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        if comparison.a is None:
            cls.poll_message_set("Enable Compare and choose two pictures first")
            return False
        if comparison.measurement and comparison.measurement.is_running:
            cls.poll_message_set("Wait until the metrics are computed")
            return False
        return True

    def execute(self, context):
        a, b, measured = comparison.a, comparison.b, comparison.measurement
        if measured is None or measured.closeness is None:
            measured = comparison.new_measurement()
            measured.run()
        if measured.closeness is None:
            self.report({"ERROR"}, measured.error)
            return {"CANCELLED"}
        path = Path(bpy.path.abspath(bpy.path.ensure_ext(self.filepath, ".png")))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as folder:  # first both files whole
                made = Path(folder) / path.name
                sheet.write(made, context.scene, a, b, measured.closeness, measured.box, comparison.settings().gain)
                made.with_suffix(".json").write_text(json.dumps(numbers(a, b, measured), indent=2) + "\n")
                replace_all({made.with_suffix(suffix): path.with_suffix(suffix) for suffix in (".json", ".png")})
        except (OSError, RuntimeError) as error:
            self.report({"ERROR"}, f"The comparison cannot be written to {path}: {error}")
            return {"CANCELLED"}
        self.report({"INFO"}, f"Wrote {path.name} and {path.with_suffix('.json').name}")
        return {"FINISHED"}


def replace_all(places: dict[Path, Path]) -> None:
    """Move files to new places on the same disk, where files are replaced: all, or none. Raises OSError."""
    moved = []
    try:
        for made, path in places.items():
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
            kept = made.with_name(f"{made.name}.old")
            if path.exists():
                path.replace(kept)
                moved.append((kept, path))
            made.replace(path)
            moved.append((path, made))
    except OSError:
        for now, before in reversed(moved):
            now.replace(before)
        raise


def numbers(a, b, measured: Measurement) -> dict:
    """What the JSON file holds."""
    close = measured.closeness
    return {
        "a": {"name": a.name, **a.credits._asdict()},
        "b": {"name": b.name, **b.credits._asdict()},
        "width": a.pixels.shape[1], "height": a.pixels.shape[0],
        "region": dict(zip(("left", "bottom", "right", "top"), measured.box.area)),
        "psnr": close.psnr, "ssim": close.ssim, "flip": close.flip, "lpips": close.lpips,
        "notes": measured.notes,
        "pixels_per_degree": flip.PIXELS_PER_DEGREE,
        "measured": "clipped to [0, 1] and sRGB-encoded, without the view transform and alpha",
    }


register, unregister = classes(RENDERFORMER_OT_compare_export)
