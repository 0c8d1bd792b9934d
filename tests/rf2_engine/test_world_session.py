# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds that Cycles has to evaluate: what the tokens say of them against Cycles' irradiance."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine import layer, statistics

from tests.rf2_engine.convert.cycles_reference import irradiance
from tests.rf2_engine.convert.test_suns import light
from tests.rf2_engine.convert.worlds import sky_world
from .f12 import cube

NORMALS = (0, 0, 1), (1, 0.3, 0.2), (-0.5, -1, 0.3)


@pytest.fixture
def tokens(scene, monkeypatch):
    """Function that presses F12 and gives the tokens."""
    seen = []

    def record(found, tokens, view):
        seen.append(tokens)
        raise RenderCancelled  # the network has nothing to do with it

    def run():
        monkeypatch.setattr(layer, "make_guides", record)
        bpy.ops.render.render(scene=scene.name)
        return seen.pop()
    return run


def measured(scene):
    """(3, 3) irradiance in Cycles' picture, of NORMALS."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 1024, False, 0
    scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    for obj in list(scene.objects):
        bpy.data.objects.remove(obj)
    return np.array([irradiance((0, 0, 0), normal) for normal in NORMALS])


KINDS = [name for name in ("NISHITA", "SINGLE_SCATTERING", "MULTIPLE_SCATTERING", "PREETHAM", "HOSEK_WILKIE")
         if name in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items.keys()]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sky_gives_the_light_that_it_gives_in_cycles(scene, tokens, kind):
    cube(scene)
    sky_world(0.5, disc=True, size=0.02, kind=(kind,))
    scene_tokens = tokens()
    found = np.array([light(scene_tokens, normal) for normal in NORMALS])
    print("XX", scene_tokens.is_light.sum(), statistics.last_frame)
    expected = measured(scene)
    print("XX", kind, (found / expected).round(3).tolist())
    np.testing.assert_allclose(found, expected, rtol=0.02)
