# SPDX-License-Identifier: GPL-3.0-or-later
"""The one table of render passes: our stable key, Blender's name by version, channels and where the pixels come from.

Cycles, run inside our engine, fills whatever passes our render result has, so the table serves three ends: it is
registered for the compositor, it tells Cycles what to compute, and it names what the engine writes.
"""
from __future__ import annotations

from typing import NamedTuple

import bpy


class Pass(NamedTuple):
    key: str             # our name, the same in every Blender version
    name: str            # Blender's name up to 4.5
    name_5: str          # Blender's name from 5.0
    channels: str
    kind: str            # COLOR, VECTOR or VALUE: the type of the compositor's socket
    source: str          # network | guide (first hits) | data (first hits, on request) | lighting (reference only)
    setting: str = ""    # the ViewLayer property that asks for it; empty: always there

    @property
    def blender_name(self) -> str:
        return self.name_5 if bpy.app.version >= (5, 0, 0) else self.name


PASSES = (
    Pass("combined", "Combined", "Combined", "RGBA", "COLOR", "network"),
    Pass("depth", "Depth", "Depth", "Z", "VALUE", "guide"),
    Pass("position", "Position", "Position", "XYZ", "VECTOR", "guide"),
    Pass("normal", "Normal", "Normal", "XYZ", "VECTOR", "guide"),
    Pass("diffuse_color", "DiffCol", "Diffuse Color", "RGB", "COLOR", "guide"),
    Pass("glossy_color", "GlossCol", "Glossy Color", "RGB", "COLOR", "guide"),
    Pass("transmission_color", "TransCol", "Transmission Color", "RGB", "COLOR", "guide"),
    Pass("emission", "Emit", "Emission", "RGB", "COLOR", "guide"),
    Pass("environment", "Env", "Environment", "RGB", "COLOR", "guide"),
    Pass("mist", "Mist", "Mist", "Z", "VALUE", "data", "use_pass_mist"),
    Pass("uv", "UV", "UV", "UVA", "VECTOR", "data", "use_pass_uv"),
    Pass("object_index", "IndexOB", "Object Index", "X", "VALUE", "data", "use_pass_object_index"),
    Pass("material_index", "IndexMA", "Material Index", "X", "VALUE", "data", "use_pass_material_index"),
    Pass("diffuse_direct", "DiffDir", "Diffuse Direct", "RGB", "COLOR", "lighting"),
    Pass("diffuse_indirect", "DiffInd", "Diffuse Indirect", "RGB", "COLOR", "lighting"),
    Pass("glossy_direct", "GlossDir", "Glossy Direct", "RGB", "COLOR", "lighting"),
    Pass("glossy_indirect", "GlossInd", "Glossy Indirect", "RGB", "COLOR", "lighting"),
    Pass("transmission_direct", "TransDir", "Transmission Direct", "RGB", "COLOR", "lighting"),
    Pass("transmission_indirect", "TransInd", "Transmission Indirect", "RGB", "COLOR", "lighting"),
    Pass("volume_direct", "VolumeDir", "Volume Direct", "RGB", "COLOR", "lighting"),
    Pass("volume_indirect", "VolumeInd", "Volume Indirect", "RGB", "COLOR", "lighting"),
)

# What a reference beside our picture adds, under names that are the same in every Blender version.
REFERENCE = (
    Pass("cycles_reference", "Cycles Reference", "Cycles Reference", "RGBA", "COLOR", "reference"),
    *(Pass(f"cycles_{p.key}", f"Cycles {p.name_5}", f"Cycles {p.name_5}", p.channels, p.kind, "reference")
      for p in PASSES if p.source == "lighting"),
)


def of_view_layer(view_layer: bpy.types.ViewLayer) -> list[Pass]:
    """The passes of a final frame: Combined, the guides, and what the user ticked for this view layer."""
    return [p for p in PASSES
            if p.source != "lighting" and (not p.setting or getattr(view_layer, p.setting, False))]


def of_session(view_layer: bpy.types.ViewLayer, lighting: bool) -> list[Pass]:
    """The passes of one Cycles session: those of a final frame, and the light passes when it computes a reference."""
    return of_view_layer(view_layer) + [p for p in PASSES if lighting and p.source == "lighting"]


def register(engine: bpy.types.RenderEngine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Announce the passes of a final frame: they become sockets of the Render Layers node and layers of the file."""
    for p in of_view_layer(view_layer):
        engine.register_pass(scene, view_layer, p.blender_name, len(p.channels), p.channels, p.kind)
