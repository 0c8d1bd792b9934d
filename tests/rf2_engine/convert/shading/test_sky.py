# SPDX-License-Identifier: GPL-3.0-or-later
"""Sky Textures where Cycles does not draw them, beside those that it draws."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.suns import split_suns
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.world import convert_world

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance
from tests.rf2_engine.convert.token_light import gathered
from tests.rf2_engine.convert.worlds import sky_world

NORMALS = (0, 0, 1), (1, 0.2, 0.3), (-0.4, 1, 0.2), (-1, -1, 0.1)
OFF = {"NISHITA": 0.04, "SINGLE_SCATTERING": 0.04, "PREETHAM": 0.02, "MULTIPLE_SCATTERING": 0.15}
KNOWN = [kind for kind in OFF
         if kind in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items.keys()]


@pytest.mark.parametrize("elevation, more", [(0.1, 3), (0.5, 1), (1.2, 1)])
@pytest.mark.parametrize("kind", KNOWN)
def test_a_sky_has_about_the_light_that_it_has_in_cycles(kind, elevation, more):
    """It is farther off, a little, while the sun is low."""
    empty_cycles_scene(samples=64)
    made = sky_world(elevation, kind=(kind,))
    made.node_tree.nodes["Sky Texture"].sun_direction = 0.5, np.cos(elevation), np.sin(elevation)
    panorama, rtol = convert_world(copied(made), Report()), min(more * OFF[kind], 0.2)
    for normal in NORMALS:
        np.testing.assert_allclose(gathered(panorama, normal), irradiance((0, 0, 0), normal), rtol=rtol)


@pytest.mark.parametrize("changes", [{"altitude": 3000}, {"air_density": 2}, {"ozone_density": 5}])
def test_the_older_sky_knows_the_air(changes):
    empty_cycles_scene(samples=64)
    made = sky_world(0.4)
    for name, value in changes.items():
        setattr(made.node_tree.nodes["Sky Texture"], name, value)
    panorama = convert_world(copied(made), Report())
    for normal in NORMALS[:2]:
        np.testing.assert_allclose(gathered(panorama, normal), irradiance((0, 0, 0), normal), rtol=0.1)


@pytest.mark.parametrize("changes", [{"altitude": 1e5}, {"sun_elevation": -1.5}, {"air_density": 0}])
def test_no_sky_has_light_that_is_no_number(changes):
    empty_cycles_scene()
    made = sky_world(0.4, disc=True)
    for name, value in changes.items():
        setattr(made.node_tree.nodes["Sky Texture"], name, value)
    panorama = convert_world(copied(made), Report())
    assert np.isfinite(panorama).all() and (panorama >= 0).all()


@pytest.mark.parametrize("elevation, rtol", [(0.15, 0.1), (0.8, 0.03)])
def test_its_sun_has_the_colour_and_strength_that_air_leaves_it(elevation, rtol):
    empty_cycles_scene(samples=64)
    made = sky_world(elevation, disc=True)
    _, (sun,) = split_suns(convert_world(copied(made), Report()))
    node = made.node_tree.nodes["Sky Texture"]
    with_sun = irradiance((0, 0, 0), sun.toward)
    node.sun_disc = False
    np.testing.assert_allclose(sun.irradiance, with_sun - irradiance((0, 0, 0), sun.toward), rtol=rtol)
