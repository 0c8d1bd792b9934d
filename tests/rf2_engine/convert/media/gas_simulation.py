# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of test_gas.py: a simulation lives in a process of its own, for Blender dies when it is freed."""
import ctypes
import gc

import bpy
import numpy as np

from tests.rf2_engine.convert.cycles_reference import pictured, world
from tests.rf2_engine.convert.media.test_optical_depth import (
    PATCHES,
    PIXELS,
    SIDE,
    background_left,
    patches,
    principled,
)


def let_mantaflow_run():
    """In the bpy wheel Mantaflow's level sets have lost the methods of the grids that they are.

    Without this one not even sources emit. Nothing flows without the others, so what was emitted stays where it is.
    """
    import manta
    gc.get_referents(manta.LevelsetGrid.__dict__)[0]["setConst"] = lambda *values, **options: None
    ctypes.pythonapi.PyType_Modified(ctypes.py_object(manta.LevelsetGrid))


def with_fluid(obj, kind):
    modifier = obj.modifiers.new("Fluid", "FLUID")
    modifier.fluid_type = kind
    return modifier.domain_settings if kind == "DOMAIN" else modifier.flow_settings


def test_gas_is_as_dense_as_in_cycles(scene, converted, report, tmp_path):
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 256, False, 0
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.cycles.volume_step_rate = 0.3
    made, _, background = world()
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    made.cycles_visibility.scatter = False
    bpy.ops.mesh.primitive_cube_add(size=1.9, rotation=(0, 0, 0.1))
    obj = bpy.context.object
    obj.data.materials.append(principled(6.0))
    domain = with_fluid(obj, "DOMAIN")
    domain.domain_type, domain.resolution_max, domain.cache_directory = "GAS", 16, str(tmp_path)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, location=(0.2, 0.1, 0))
    bpy.context.object.hide_render = True
    flow = with_fluid(bpy.context.object, "FLOW")
    flow.flow_type, flow.flow_behavior = "SMOKE", "INFLOW"
    scene.frame_set(1)
    assert converted().volumes is None and any("has no grid density" in line for line in report.lines())
    let_mantaflow_run()
    domain.resolution_max = 17
    for frame in (1, 2):
        scene.frame_set(frame)
    found = background_left(converted().volumes)
    measured = patches(pictured(SIDE, height=3, resolution=PATCHES * PIXELS))
    assert measured.max() < 0.95
    np.testing.assert_allclose(np.log(found), np.log(measured), rtol=0.05)
