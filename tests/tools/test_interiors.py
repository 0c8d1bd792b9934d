# SPDX-License-Identifier: GPL-3.0-or-later
"""The indirect profile: closed rooms that light enters in every promised way, well exposed."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILD = """
import json, sys, bpy
from tools.datagen.scenes import exposure, generator, indirect_light, interiors
from tools.extension import leave
bpy.ops.wm.read_factory_settings(use_empty=True)
found = {}
for way in indirect_light.BUILDERS:
    interiors.CHANCES = {way: 1.0}
    before = bpy.context.scene.render.engine, bpy.context.scene.render.filepath, bpy.context.scene.cycles.samples
    setup = generator.build_scene((5, 0), "indirect", 1)
    after = bpy.context.scene.render.engine, bpy.context.scene.render.filepath, bpy.context.scene.cycles.samples
    cycles = exposure.measure_median(setup.cameras[0])
    found[way] = {"median": cycles, "kept": before == after, "budget": setup.token_budget,
                  "names": sorted({o.name.partition(" ")[0] for o in bpy.data.objects}),
                  "images": [image.name for image in bpy.data.images if "probe" in image.name]}
with open(sys.argv[1], "w") as file:
    json.dump(found, file)
leave(0)
"""
MADE = {"door": {"leaf", "next", "back"}, "window": {"back"}, "shade": {"shade", "bulb"}, "uplight": {"bowl", "lamp"},
        "cove": {"ledge", "lip", "lamp"}, "screen": {"board", "bulb"}, "bulbs": {"bulb"}}


@pytest.fixture(scope="module")
def rooms(tmp_path_factory) -> dict[str, dict]:
    path = tmp_path_factory.mktemp("rooms") / "rooms.json"
    done = subprocess.run([sys.executable, "-c", BUILD, str(path)], cwd=ROOT, capture_output=True, text=True,
                          timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(path.read_text())


@pytest.mark.parametrize("way", MADE)
def test_light_enters_in_every_way(rooms, way):
    assert MADE[way] <= set(rooms[way]["names"]) and {"object", "side"} <= set(rooms[way]["names"])


def test_pictures_are_well_exposed_and_no_setting_is_changed(rooms):
    assert all(0.05 < room["median"] < 1.2 for room in rooms.values()), rooms
    assert all(room["kept"] and not room["images"] for room in rooms.values())
