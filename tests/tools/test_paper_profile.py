# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.datagen --profile paper`: materials and lamps lie in the ranges of the paper's section "Training Data"."""
import bpy
import numpy as np
import pytest

from tools.datagen.scenes import generator, paper, paper_materials

SEEDS = range(1, 9)


def values(node, *names) -> np.ndarray:
    return np.array([node.inputs[name].default_value for name in names])


@pytest.mark.parametrize("seed", SEEDS)
def test_lights_are_triangles_that_share_the_papers_radiance_far_outside(seed):
    generator.build_scene((seed, 0), "paper", 1)
    lights = [light for light in bpy.data.objects if light.name.startswith("light")]
    assert 1 <= len(lights) <= paper.LIGHTS
    for light in lights:
        shader = light.data.materials[0].node_tree.nodes["Principled BSDF"]
        radiance = np.array(shader.inputs["Emission Color"].default_value[:3])
        radiance = radiance * shader.inputs["Emission Strength"].default_value * len(lights)
        assert (radiance >= 2499).all() and (radiance <= 5001).all()
        assert 2.099 <= light.location.length <= 2.701 and not light.visible_camera and len(light.data.polygons) == 1


def test_diffuse_and_specular_reflect_nearly_all_and_glass_is_closed():
    rng, kinds = np.random.default_rng(0), set()
    for closed in [True, False] * 40:
        material = paper_materials.build_paper_material(rng, "object", closed=closed)
        nodes = material.node_tree.nodes
        kind = material.name.partition(".")[0]
        kinds.add(kind)
        assert closed or kind != "transparent"
        if kind == "dielectric":
            diffuse, glossy = (np.array(nodes[name].inputs["Color"].default_value[:3])
                               for name in ("Diffuse BSDF", "Glossy BSDF"))
            total = diffuse + glossy
            assert np.ptp(total) < 1e-5 and 0.9 <= total[0] + 1e-6 and total[0] <= 1 + 1e-6
            assert 0.01 <= nodes["Glossy BSDF"].inputs["Roughness"].default_value <= 1
        if kind == "transparent":
            metallic, ior, weight = values(nodes["Principled BSDF"], "Metallic", "IOR", "Transmission Weight")
            assert 0 <= metallic <= 1 and 1 <= ior <= 2.5 and 0 < weight <= 1
    assert kinds == set(paper_materials.CLASSES)


@pytest.mark.parametrize("make, closed", [("primitive_cube_add", True), ("primitive_plane_add", False),
                                          ("primitive_uv_sphere_add", True)])
def test_meshes_are_closed_where_every_edge_has_two_faces(make, closed):
    getattr(bpy.ops.mesh, make)()
    assert paper_materials.is_closed(bpy.context.object.data) == closed
