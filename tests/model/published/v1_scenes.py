# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of the first RenderFormer: a cube."""
import json

CUBE = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)]
SIDES = (1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)
MATERIAL = {"diffuse": [0.8, 0.4, 0.2], "specular": [0.1, 0.1, 0.1], "roughness": 0.3, "emissive": [0, 0, 0],
            "smooth_shading": True, "rand_tri_diffuse_seed": None}
STILL = {"translation": [0, 0, 0], "rotation": [0, 0, 0], "scale": [1, 1, 1], "normalize": False}
CAMERA = {"position": [0, -2, 0], "look_at": [0, 0, 0], "up": [0, 0, 1], "fov": 40}


def write_scene(folder, transform=STILL, material=MATERIAL, **more):
    """A cube with corners at 0 and 2, each side a polygon of four corners."""
    (folder / "objects").mkdir(parents=True)
    (folder / "objects" / "cube.obj").write_text("".join(
        [f"v {x} {y} {z}\n" for x, y, z in CUBE] + ["f " + " ".join(map(str, side)) + "\n" for side in SIDES]))
    scene = {"scene_name": "one cube", "version": "1.0", "cameras": [CAMERA], "objects": {
        "cube": {"mesh_path": "objects/cube.obj", "transform": transform, "material": material} | more}}
    (folder / "scene.json").write_text(json.dumps(scene))
    return folder / "scene.json"
