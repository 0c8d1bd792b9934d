# SPDX-License-Identifier: GPL-3.0-or-later
"""Old profiles keep the scenes of their seeds; the wide and the layered one make everything that they promise."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIST = """
import json, sys, bpy
from tools.datagen.scenes import generator
from tools.extension import leave
bpy.ops.wm.read_factory_settings(use_empty=True)
scenes = {}
layers = json.loads(sys.argv[3])
for seed, profile in json.loads(sys.argv[1]):
    setup = generator.build_scene((seed, 0), profile, 2)
    tree = bpy.context.scene.world.node_tree
    scenes[f"{profile} {seed}"] = {
        "objects": {o.name: [round(x, 3) for x in o.location] for o in bpy.data.objects},
        "vertices": [len(o.data.vertices) for o in sorted(bpy.data.objects, key=lambda o: o.name) if o.type == "MESH"],
        "size": max(max(o.dimensions) for o in bpy.data.objects),
        "materials": sorted({m.name.partition(".")[0] for m in bpy.data.materials}),
        "layers": sorted({socket.name for m in bpy.data.materials for node in m.node_tree.nodes
                          if node.type == "BSDF_PRINCIPLED" for socket in node.inputs
                          if socket.name in layers and not socket.is_linked and socket.default_value}),
        "lamps": [light.type for light in bpy.data.lights],
        "world": [n.bl_idname for n in tree.nodes] + [n.image.name for n in tree.nodes if hasattr(n, "image")],
        "panels": [sorted(o.dimensions) for o in bpy.data.objects if o.name.startswith("panel")],
        "lenses": [o.data.angle for o in setup.cameras],
        "budget": setup.token_budget, "resolution": setup.resolution}
with open(sys.argv[2], "w") as file:
    json.dump(scenes, file)
leave(0)
"""
HELD_OUT = {  # last light and last camera: what is drawn at the end changes with anything before
    "full 900000": ([2.011, -0.564, 0.791], [-0.155, -0.713, 1.43], [3, 3, 3, 6, 8, 143, 321, 81, 64]),
    "full 900001": ([-0.779, -2.198, 0.996], [0.241, -0.937, 1.348], [3, 321, 321, 122, 64, 64, 100, 64]),
    "simple 3": ([0.376, -0.276, 1.912], [-0.58, 0.248, 1.184], [98, 100]),
}
WIDE = range(1, 61)
LAYERED = range(900000, 900010)
LAYERS = ["Coat Weight", "Sheen Weight", "Subsurface Weight", "Thin Film Thickness", "Anisotropic", "Diffuse Roughness"]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> dict[str, dict]:
    path = tmp_path_factory.mktemp("scenes") / "scenes.json"
    wanted = [(int(name.split()[1]), name.split()[0]) for name in HELD_OUT] + [
        (seed, profile) for profile, seeds in (("wide", WIDE), ("layered", LAYERED)) for seed in seeds]
    done = subprocess.run([sys.executable, "-c", LIST, json.dumps(wanted), str(path), json.dumps(LAYERS)], cwd=ROOT,
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(path.read_text())


@pytest.fixture(scope="module")
def wide(scenes) -> list[dict]:
    return [scenes[f"wide {seed}"] for seed in WIDE]


@pytest.mark.parametrize("name", HELD_OUT)
def test_the_scenes_of_old_seeds_stay_what_they_were(scenes, name):
    light, camera, vertices = HELD_OUT[name]
    lights = [place for key, place in scenes[name]["objects"].items() if key.startswith("light")]
    assert lights[-1] == pytest.approx(light, abs=2e-3)
    assert scenes[name]["objects"]["camera 1"] == pytest.approx(camera, abs=2e-3)
    assert scenes[name]["vertices"] == vertices and (scenes[name]["budget"], scenes[name]["resolution"]) == (3072, 128)


def test_wide_scenes_stand_in_rooms_on_any_ground_or_before_the_sky(wide):
    sides = [sum(name.startswith("side") for name in scene["objects"]) for scene in wide]
    assert {0, 1} < set(sides) and max(sides) >= 3
    grounds = [scene["size"] for scene, count in zip(wide, sides, strict=True) if count == 1]
    assert min(grounds) < 2 and max(grounds) > 1000


def test_wide_scenes_hold_mirrors_clear_glass_fog_smoke_panels_and_screens(wide):
    names = {name.partition(" ")[0] for scene in wide for name in scene["objects"]}
    materials = {name for scene in wide for name in scene["materials"]}
    assert names >= {"mirror", "glass", "fog", "smoke", "panel", "sun"}
    assert materials >= {"mirror", "clear glass", "textured_dielectric", "textured_metallic", "fog", "volume"}
    thin = [panel for scene in wide for panel in scene["panels"]]
    assert thin and all(panel[0] < 0.05 * panel[2] for panel in thin)


def test_wide_scenes_lie_under_all_kinds_of_worlds(wide):
    nodes = {node for scene in wide for node in scene["world"]}
    assert nodes >= {"ShaderNodeTexSky", "ShaderNodeTexEnvironment", "panorama"}
    assert any(scene["lamps"] == ["SUN"] for scene in wide), "no sky with its sun alone"


def test_wide_scenes_differ_in_size_lens_and_resolution(wide):
    budgets, lenses = [scene["budget"] for scene in wide], [lens for scene in wide for lens in scene["lenses"]]
    assert 2000 < min(budgets) < 3000 and 12000 < max(budgets) <= 16384
    assert min(lenses) < 0.45 and max(lenses) > 1.3 and len({scene["resolution"] for scene in wide}) > 2


def test_layered_scenes_are_those_of_the_full_profile_with_layers_that_estimates_do_not_know(scenes):
    layered, full = scenes["layered 900000"], scenes["full 900000"]
    assert layered["objects"] == full["objects"] and not full["layers"]
    assert set().union(*(scenes[f"layered {seed}"]["layers"] for seed in LAYERED)) == set(LAYERS)
