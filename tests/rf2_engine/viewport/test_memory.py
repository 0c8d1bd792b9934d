# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene can be edited for hours."""
import gc
import os

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import viewport
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Session
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.source import Source, source_key

from tests.rf2_engine.f12 import cube, material, sun
from tests.rf2_engine.viewport.views import depsgraph, pictures, read, request, through_camera

UPDATES, WARM = 300, 60


def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="the system does not say how much memory it holds")
def test_memory_stays_the_same_over_many_updates(scene):
    moving = cube(scene, of=material("Red", (0.8, 0.05, 0.05)))
    moving.modifiers.new("Finer", "SUBSURF").levels = 5
    sun(scene)
    scene.renderformer_v2.viewport.resolution, scene.renderformer_v2.viewport.token_budget = "8", 256
    bpy.context.view_layer.update()
    source = viewport._sources[source_key(depsgraph())] = Source()
    session, held = Session(), []
    for i in range(UPDATES):
        if i % 3 == 0:
            moving.location.x = np.sin(i)
        elif i % 3 == 1:
            moving.modifiers[0].levels = 4 + i % 2
        else:
            scene.camera.location.x = np.cos(i) / 2
        bpy.context.view_layer.update()
        session.submit(request(scene, read(source), through_camera(scene, 64 + 8 * (i % 5), 48)))
        pictures(session)
        gc.collect()
        held.append(resident())
    assert max(held[-WARM:]) < 1.05 * max(held[:WARM])
