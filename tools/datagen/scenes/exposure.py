# SPDX-License-Identifier: GPL-3.0-or-later
"""The brightness of all lights, set by a quick picture."""
from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

SIZE, SAMPLES = 24, 32
MEDIAN = 0.25                 # of the picture, on average over scenes
LEAST = 1e-6                  # of a picture with any light to speak of


def expose(rng: np.random.Generator, camera: bpy.types.Object) -> bool:
    """Scale all lamps, glowing materials and the world, so that the picture's median is near MEDIAN.

    Returns False, and scales nothing, when there is hardly any light.
    """
    median = measure_median(camera)
    if median < LEAST:
        return False
    scale_lights(MEDIAN * np.exp(rng.normal(0.0, 0.4)) / median)
    return True


def measure_median(camera: bpy.types.Object) -> float:
    """Radiance in W/(m^2 sr) that half the pixels exceed, by Cycles with a few samples. Changes no setting."""
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    changed = {render: ("engine", "filepath", "resolution_x", "resolution_y"), scene: ("camera",),
               cycles: ("samples", "use_denoising", "use_adaptive_sampling"), render.image_settings: ("file_format",)}
    before = [(owner, name, getattr(owner, name)) for owner, names in changed.items() for name in names]
    with tempfile.TemporaryDirectory() as folder:
        render.engine, render.filepath = "CYCLES", str(Path(folder) / "probe.exr")
        render.resolution_x = render.resolution_y = SIZE
        render.image_settings.file_format = "OPEN_EXR"
        cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = SAMPLES, False, False
        scene.camera = camera
        try:
            bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(render.filepath)
            pixels = np.array(image.pixels[:], np.float32).reshape(-1, 4)
            bpy.data.images.remove(image)
        finally:
            for owner, name, value in before:
                setattr(owner, name, value)
    return float(np.median(pixels[:, :3].mean(axis=1)))


def scale_lights(factor: float) -> None:
    """Multiply the brightness of all lamps, glowing materials and worlds by `factor`."""
    for light in bpy.data.lights:
        light.energy *= factor
    trees = [owner.node_tree for owner in (*bpy.data.materials, *bpy.data.worlds) if owner.node_tree]
    for node in (node for tree in trees for node in tree.nodes):
        if node.type == "BACKGROUND":
            node.inputs["Strength"].default_value *= factor
        elif node.type == "BSDF_PRINCIPLED":
            node.inputs["Emission Strength"].default_value *= factor
