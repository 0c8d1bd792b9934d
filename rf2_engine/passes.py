# SPDX-License-Identifier: GPL-3.0-or-later
"""The one table of render passes: our stable key, Blender's name by version, channels and where the pixels come from.

Cycles, run inside our engine, fills whatever passes our render result has, so the table serves three ends: what is
ticked is registered for the compositor, it tells Cycles what to compute, and it names what the engine writes.
"""
from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

import bpy
import numpy as np

STORED = "cycles.denoising_store_passes"


class Pass(NamedTuple):
    key: str             # our name, the same in every Blender version
    name: str            # Blender's name up to 4.5
    name_5: str          # Blender's name from 5.0
    channels: str
    kind: str            # COLOR, VECTOR or VALUE: the type of the compositor's socket
    # network | guide (first hits, always computed) | data (first hits) | lighting (the network's) | catcher | group
    source: str
    setting: str = ""    # path of the view layer's property that asks for it; empty: always there
    since: tuple = (4, 5, 0)

    @property
    def blender_name(self) -> str:
        return self.name_5 if bpy.app.version >= (5, 0, 0) else self.name

    @property
    def heading(self) -> tuple[str, str]:
        """Where the panel has it, and how it is called there: ("Diffuse", "Direct"), ("Data", "Mist")."""
        if self.setting == STORED:
            return "Data", "Denoising Data"
        lobe, _, light = self.name_5.partition(" ")
        if light in ("Direct", "Indirect", "Color"):
            return lobe, light
        if self.key == "ambient_occlusion":
            return "Other", "AO"  # all of it would be cut at the usual width
        return "Other" if self.key in ("emission", "environment", "shadow_catcher") else "Data", self.name_5

    def is_ticked(self, view_layer: bpy.types.ViewLayer) -> bool:
        """True if the view layer has it ticked; Cycles' own properties are there while Cycles is enabled."""
        owner, _, name = self.setting.rpartition(".")
        return not name or bool(getattr(getattr(view_layer, owner, None) if owner else view_layer, name, False))


PASSES = tuple(p for p in (
    Pass("combined", "Combined", "Combined", "RGBA", "COLOR", "network"),
    Pass("depth", "Depth", "Depth", "Z", "VALUE", "guide", "use_pass_z"),
    Pass("mist", "Mist", "Mist", "Z", "VALUE", "data", "use_pass_mist"),
    Pass("position", "Position", "Position", "XYZ", "VECTOR", "guide", "use_pass_position"),
    Pass("normal", "Normal", "Normal", "XYZ", "VECTOR", "guide", "use_pass_normal"),
    Pass("vector", "Vector", "Vector", "XYZW", "VECTOR", "data", "use_pass_vector"),
    Pass("uv", "UV", "UV", "UVA", "VECTOR", "data", "use_pass_uv"),
    Pass("object_index", "IndexOB", "Object Index", "X", "VALUE", "data", "use_pass_object_index"),
    Pass("material_index", "IndexMA", "Material Index", "X", "VALUE", "data", "use_pass_material_index"),
    Pass("denoising_albedo", "Denoising Albedo", "Denoising Albedo", "RGB", "COLOR", "data", STORED),
    Pass("denoising_specular_albedo", "", "Denoising Specular Albedo", "RGB", "COLOR", "data", STORED, (5, 2, 0)),
    Pass("denoising_normal", "Denoising Normal", "Denoising Normal", "XYZ", "VECTOR", "data", STORED),
    Pass("denoising_roughness", "", "Denoising Roughness", "X", "VALUE", "data", STORED, (5, 2, 0)),
    Pass("denoising_depth", "Denoising Depth", "Denoising Depth", "Z", "VALUE", "data", STORED),
    Pass("diffuse_direct", "DiffDir", "Diffuse Direct", "RGB", "COLOR", "lighting", "use_pass_diffuse_direct"),
    Pass("diffuse_indirect", "DiffInd", "Diffuse Indirect", "RGB", "COLOR", "lighting", "use_pass_diffuse_indirect"),
    Pass("diffuse_color", "DiffCol", "Diffuse Color", "RGB", "COLOR", "guide", "use_pass_diffuse_color"),
    Pass("glossy_direct", "GlossDir", "Glossy Direct", "RGB", "COLOR", "lighting", "use_pass_glossy_direct"),
    Pass("glossy_indirect", "GlossInd", "Glossy Indirect", "RGB", "COLOR", "lighting", "use_pass_glossy_indirect"),
    Pass("glossy_color", "GlossCol", "Glossy Color", "RGB", "COLOR", "guide", "use_pass_glossy_color"),
    Pass("transmission_direct", "TransDir", "Transmission Direct", "RGB", "COLOR", "lighting",
         "use_pass_transmission_direct"),
    Pass("transmission_indirect", "TransInd", "Transmission Indirect", "RGB", "COLOR", "lighting",
         "use_pass_transmission_indirect"),
    Pass("transmission_color", "TransCol", "Transmission Color", "RGB", "COLOR", "guide",
         "use_pass_transmission_color"),
    Pass("volume_direct", "VolumeDir", "Volume Direct", "RGB", "COLOR", "lighting", "cycles.use_pass_volume_direct"),
    Pass("volume_indirect", "VolumeInd", "Volume Indirect", "RGB", "COLOR", "lighting",
         "cycles.use_pass_volume_indirect"),
    Pass("emission", "Emit", "Emission", "RGB", "COLOR", "guide", "use_pass_emit"),
    Pass("environment", "Env", "Environment", "RGB", "COLOR", "guide", "use_pass_environment"),
    Pass("ambient_occlusion", "AO", "Ambient Occlusion", "RGB", "COLOR", "data", "use_pass_ambient_occlusion"),
    Pass("shadow_catcher", "Shadow Catcher", "Shadow Catcher", "RGB", "COLOR", "catcher",
         "cycles.use_pass_shadow_catcher"),
    # of a pixel, as a share of the samples of the session; 1 without a noise threshold
    Pass("sample_count", "Debug Sample Count", "Debug Sample Count", "X", "VALUE", "data",
         "cycles.pass_debug_sample_count"),
) if bpy.app.version >= p.since)

LIGHTING = frozenset(p.key for p in PASSES if p.source == "lighting")

OF_LIGHT = ("lighting", "catcher")  # sources of passes that depend on the weights and on Light

SAMPLE_COUNT = next(p for p in PASSES if p.key == "sample_count")
SHADOW_CATCHER = next(p for p in PASSES if p.key == "shadow_catcher")
NOISY = Pass("noisy", "Noisy Image", "Noisy Image", "RGBA", "COLOR", "data", STORED)  # before the denoiser

# What a reference beside our picture adds, under names that are the same in every Blender version.
REFERENCE = (
    Pass("cycles_reference", "Cycles Reference", "Cycles Reference", "RGBA", "COLOR", "reference"),
    *(Pass(f"cycles_{p.key}", f"Cycles {p.name_5}", f"Cycles {p.name_5}", p.channels, p.kind, "reference")
      for p in PASSES if p.source == "lighting"),
)
REFERENCE_NAMES = frozenset(p.blender_name for p in REFERENCE)
_KEYS = {p.blender_name: p.key for p in (*PASSES, NOISY, *REFERENCE)}


def pass_key(blender_name: str) -> str:
    """Key of the pass that Blender calls so; Cryptomattes and shader AOVs have no row in the table."""
    return _KEYS.get(blender_name, f"own {blender_name}")


def ticked_passes(view_layer: bpy.types.ViewLayer, lighting: Collection[str],
                  scene: bpy.types.Scene | None = None) -> list[Pass]:
    """The passes that were ticked for this view layer, of those OF_LIGHT the ones whose keys are in `lighting`.

    Those of light groups are among them if there are any light passes. `scene` is its own, which a view layer that
    Blender gives to update_render_passes does not know.
    What we compute under the name of a shader AOV is among them, for Blender then marks the AOV as in conflict.
    """
    aov_names = {aov.name for aov in view_layer.aovs}
    ticked = [p for p in PASSES if (p.source not in OF_LIGHT or p.key in lighting) and (
        p.is_ticked(view_layer) or p.source in ("guide", "lighting") and p.blender_name in aov_names)]
    groups = light_groups(view_layer, lighting)
    # Without it, and before them, Cycles denoises the first light group and calls that Combined.
    noisy = [NOISY] if groups or _is_noisy_ticked(view_layer, scene or view_layer.id_data) else []
    return ticked + noisy + [*_cryptomattes(view_layer), *_shader_aovs(view_layer), *groups]


def _is_noisy_ticked(view_layer: bpy.types.ViewLayer, scene: bpy.types.Scene) -> bool:
    """True where Cycles has it, but only with Denoising Data."""
    return NOISY.is_ticked(view_layer) and is_denoised(view_layer, scene)


def is_denoised(view_layer: bpy.types.ViewLayer, scene: bpy.types.Scene) -> bool:
    """True if Cycles, as it is set, denoises the picture of a view layer."""
    settings = getattr(view_layer, "cycles", None)
    return bool(settings and settings.use_denoising and scene.cycles.use_denoising)


def absent(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, lighting: Collection[str]) -> list[str]:
    """Names of passes that Cycles would give of this view layer, and we cannot."""
    try:
        from cycles.engine import list_render_passes
        cycles_names = [name for name, *_ in list_render_passes(scene, view_layer)]
    except (ImportError, AttributeError, TypeError):
        return []  # a Cycles that does not tell
    ours = {p.blender_name for p in ticked_passes(view_layer, lighting, scene)}
    return [name for name in cycles_names if name not in ours and not name.startswith("Noisy ")]


def is_light_requested(view_layer: bpy.types.ViewLayer, lighting: Collection[str]) -> bool:
    """True if one of the light passes with these keys is ticked."""
    return any(p.source == "lighting" for p in ticked_passes(view_layer, lighting))


def needed_light(view_layer: bpy.types.ViewLayer, lighting: Collection[str]) -> frozenset[str]:
    """Keys of the light passes that Cycles has to give so that those with these keys that are ticked can be made.

    An added pass stays in the file. Volume Indirect alone needs all: it is what they leave of the picture.
    """
    ticked = {p.key for p in ticked_passes(view_layer, lighting) if p.source == "lighting"}
    return LIGHTING if "volume_indirect" in ticked else frozenset(ticked)


def session_passes(view_layer: bpy.types.ViewLayer, lighting: Collection[str]) -> list[Pass]:
    """The passes of one Cycles session: first hits, what the user ticked, and the light passes with these keys."""
    always = [p for p in PASSES if p.source in ("network", "guide") or p.key in lighting]
    return always + [p for p in ticked_passes(view_layer, ()) if p not in always]


def register(engine: bpy.types.RenderEngine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer,
             lighting: Collection[str] = ()) -> None:
    """Announce the ticked passes: they become sockets of the Render Layers node and layers of the file."""
    for p in ticked_passes(view_layer, lighting, scene):
        engine.register_pass(scene, view_layer, p.blender_name, len(p.channels), p.channels, p.kind)


def update_sockets(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Have the Render Layers node show the passes of the next render; `update` of the properties that decide these."""
    for view_layer in settings.id_data.view_layers:
        view_layer.update_render_passes()


def write(engine: bpy.types.RenderEngine, layer: str, passes: dict[str, np.ndarray], view: str = "") -> None:
    """Hand {pass_key(name): (H, W, C), row 0 on top} of one view layer to Blender; view "": of all views."""
    result = engine.begin_result(0, 0, engine.resolution_x, engine.resolution_y, layer=layer, view=view)
    for p in result.layers[0].passes:
        if (key := pass_key(p.name)) in passes:
            p.rect.foreach_set(np.ascontiguousarray(passes[key][::-1], np.float32).ravel())
    engine.end_result(result)


def light_groups(view_layer: bpy.types.ViewLayer, lighting: Collection[str]) -> list[Pass]:
    """A pass for each light group of a view layer, in its order, if the weights can give light passes."""
    groups = view_layer.lightgroups if lighting else ()
    return [_pass_by_name(f"Combined_{group.name}", "RGB", "COLOR", "group") for group in groups]


def _cryptomattes(view_layer: bpy.types.ViewLayer) -> Iterator[Pass]:
    """Two ranks to a pass. Their channels are in lower case: OpenEXR then never compresses them with loss."""
    for kind in ("object", "material", "asset"):
        if getattr(view_layer, f"use_pass_cryptomatte_{kind}"):
            for i in range((min(view_layer.pass_cryptomatte_depth, 16) + 1) // 2):
                yield _pass_by_name(f"Crypto{kind.capitalize()}{i:02d}", "rgba", "COLOR")


def _shader_aovs(view_layer: bpy.types.ViewLayer) -> Iterator[Pass]:
    for aov in view_layer.aovs:
        if aov.is_valid:
            yield _pass_by_name(aov.name, *(("X", "VALUE") if aov.type == "VALUE" else ("RGBA", "COLOR")))


def _pass_by_name(name: str, channels: str, kind: str, source: str = "data") -> Pass:
    return Pass(pass_key(name), name, name, channels, kind, source)
