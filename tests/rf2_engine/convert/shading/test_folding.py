# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a material one BSDF cannot show is reported, and nothing else is."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material, rendered, world
from tests.rf2_engine.convert.shading.test_material_tiles import UV, tile_of


@pytest.fixture(autouse=True)
def scene():
    empty_cycles_scene()


def mixed(first, second, kind="ShaderNodeMixShader"):
    """Two BSDFs in a Mix or Add Shader."""
    made, tree, mix = material(kind, "Both")
    for shader, entry in zip((first, second), list(mix.inputs)[-2:], strict=True):
        tree.links.new(tree.nodes.new("ShaderNode" + shader).outputs[0], entry)
    return made


def hair(parametrization):
    made, _, node = material("ShaderNodeBsdfHairPrincipled")
    node.parametrization = parametrization
    return made


@pytest.mark.parametrize("make, message", [
    (lambda: mixed("BsdfDiffuse", "BsdfGlossy"), "replaced by one"),
    (lambda: mixed("BsdfDiffuse", "BsdfGlass", "ShaderNodeAddShader"), "replaced by one"),
    (lambda: material("ShaderNodeBsdfPrincipled", Diffuse_Roughness=0.5)[0], "diffuse roughness"),
    (lambda: material("ShaderNodeBsdfDiffuse", Roughness=0.5)[0], "diffuse roughness"),
    (lambda: material(Coat_Weight=0.5)[0], "coat"), (lambda: material(Sheen_Weight=0.5)[0], "sheen"),
    (lambda: material(Subsurface_Weight=0.5)[0], "subsurface"), (lambda: material(Anisotropic=0.5)[0], "anisotropy"),
    (lambda: material(Thin_Film_Thickness=300.0)[0], "thin film"), (lambda: material(Alpha=0.5)[0], "alpha"),
    (lambda: material(Specular_Tint=(1, 0.5, 0.5, 1))[0], "specular tint"),
    (lambda: material("ShaderNodeBsdfGlossy", Anisotropy=0.5)[0], "anisotropy"),
    (lambda: material("ShaderNodeBsdfMetallic")[0], "Edge Tint"),
    (lambda: material("ShaderNodeBsdfRefraction")[0], "refraction"),
    (lambda: material("ShaderNodeBsdfTransparent", Color=(0.5, 0.5, 0.5, 1))[0], "transparency"),
    (lambda: material("ShaderNodeBsdfTranslucent")[0], "as Diffuse"),
    (lambda: material("ShaderNodeSubsurfaceScattering")[0], "as Diffuse"),
    *((lambda kind=kind: hair(kind), "as Diffuse") for kind in ("COLOR", "ABSORPTION", "MELANIN")),
    (lambda: material("ShaderNodeBsdfToon")[0], "as Diffuse"),
    (lambda: material("ShaderNodeBsdfSheen")[0], "as Diffuse"),
    (lambda: material("ShaderNodeBsdfRayPortal")[0], "as Transparent"),
    (lambda: material("ShaderNodeEeveeSpecular")[0], "use a Principled BSDF"),
])
def test_what_one_bsdf_cannot_show_is_reported(make, message):
    report = Report()
    made = make()
    tile_of(made, report)
    line, = report.lines()
    assert message in line and made.name in line


NEEDED = {  # what an input of Principled BSDF does something beside
    "Coat": dict(Coat_Weight=1.0), "Sheen": dict(Sheen_Weight=1.0), "Subsurface": dict(Subsurface_Weight=1.0),
    "Thin Wall": dict(Transmission_Weight=1.0), "Thin Film": dict(Thin_Film_Thickness=300.0),
    "Anisotropic": dict(Anisotropic=0.5), "Tangent": dict(Anisotropic=0.5),
    "Emission": dict(Emission_Color=(0.5, 0.5, 0.5, 1), Emission_Strength=0.2)}


def test_every_input_of_principled_changes_the_tile_or_is_reported():
    tried = 0
    for number, entry in enumerate(material()[2].inputs):
        if not entry.enabled or entry.type == "SHADER" or entry.name == "Weight":
            continue
        beside = next((inputs for start, inputs in NEEDED.items() if entry.name.startswith(start)), {})
        found = []
        for change in (False, True):
            made, tree, node = material(**beside)
            report = Report()
            if change and entry.type == "VECTOR" and entry.hide_value:  # Normal, Coat Normal, Tangent
                bent = tree.nodes.new("ShaderNodeNormalMap")
                bent.inputs["Color"].default_value = (0.7, 0.5, 0.9, 1)
                tree.links.new(bent.outputs[0], node.inputs[number])
            elif change:
                value = entry.default_value
                node.inputs[number].default_value = not value if entry.type == "BOOLEAN" else (
                    0.5 * value + 0.1 if isinstance(value, float) else [0.5 * each + 0.1 for each in value])
            found.append((tile_of(made, report, UV), report.lines()))
        (before, _), (after, lines) = found
        differs = any(not np.allclose(a, b, atol=1e-4) for a, b in zip(before, after, strict=True))
        assert differs or lines, entry.name
        tried += 1
    assert tried > 25


def test_an_effect_is_reported_once_for_a_material():
    made, tree, mix = material("ShaderNodeMixShader", "Both")
    for entry in list(mix.inputs)[-2:]:
        coated = tree.nodes.new("ShaderNodeBsdfPrincipled")
        coated.inputs["Coat Weight"].default_value = 1
        tree.links.new(coated.outputs[0], entry)
    report = Report()
    tile_of(made, report)
    assert sum("coat" in line for line in report.lines()) == 1


def folded(made):
    """The material that a tile of another one means: one BSDF at level 1."""
    color, (metallic, roughness, ior, transmission) = (part.tolist() for part in np.split(tile_of(made)[0][:7], [3]))
    return material(Base_Color=(*color, 1), Metallic=metallic, Roughness=roughness, IOR=ior,
                    Transmission_Weight=transmission, Specular_IOR_Level=1.0)[0]


def white_lit(made) -> float:
    """Light from a smooth ball in a white world, as Cycles shows it."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.max_bounces = 16, 4
    scene.render.resolution_x = scene.render.resolution_y = 24
    scene.render.film_transparent = True
    background = world()[2]
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=32)
    ball = bpy.context.object
    ball.data.materials.append(made)
    ball.data.shade_smooth()
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale = "ORTHO", 2
    camera = bpy.data.objects.new("Camera", data)
    camera.location = (0, 0, 5)
    scene.collection.objects.link(camera)
    scene.camera = camera
    found = rendered(scene).mean()
    for obj in (ball, camera):
        bpy.data.objects.remove(obj)
    return float(found)


@pytest.mark.parametrize("inputs", [
    dict(Coat_Weight=1.0, Coat_Roughness=0.1), dict(Coat_Weight=0.6, Coat_Tint=(0.5, 0.5, 0.5, 1)),
    dict(Sheen_Weight=1.0), dict(Sheen_Weight=0.8, Sheen_Roughness=1.0), dict(Thin_Film_Thickness=300.0),
    dict(Thin_Film_Thickness=120.0, Thin_Film_IOR=1.9), dict(Specular_Tint=(0.9, 0.1, 0.2, 1))], ids=str)
def test_layers_reflect_about_as_much_as_in_cycles(inputs):
    """As one BSDF, and closer than without the layer."""
    base = dict(Base_Color=(0.2, 0.2, 0.2, 1), Roughness=0.3)
    layered = material(**base, **inputs)[0]
    shown, ours, without = white_lit(layered), white_lit(folded(layered)), white_lit(material(**base)[0])
    assert abs(ours - shown) < 0.5 * abs(without - shown) or abs(ours - shown) < 0.03 * shown


@pytest.mark.parametrize("shader, tolerance, inputs", [
    ("Principled", 0.05, dict(Subsurface_Weight=1.0, Base_Color=(0.6, 0.6, 0.6, 1))),
    ("Principled", 0.05, dict(Anisotropic=1.0, Metallic=1.0, Roughness=0.3)), ("Metallic", 0.05, {}),
    ("Metallic", 0.05, dict(fresnel_type="PHYSICAL_CONDUCTOR")), ("Sheen", 0.15, dict(Roughness=0.8)),
    ("Toon", 0.03, {}), ("Toon", 0.1, dict(component="GLOSSY")), ("Glossy", 0.1, dict(Anisotropy=0.4, Roughness=0.3)),
    ("Diffuse", 0.03, {}), ("Glass", 0.1, dict(Color=(0.8, 0.8, 0.8, 1))),
    ("Refraction", 0.1, dict(Color=(0.8, 0.8, 0.8, 1)))], ids=str)
def test_the_nearest_bsdf_is_about_as_bright_as_in_cycles(shader, tolerance, inputs):
    settings = {key: value for key, value in inputs.items() if key.islower()}
    made, _, node = material(f"ShaderNodeBsdf{shader}", **{k: v for k, v in inputs.items() if k not in settings})
    for key, value in settings.items():
        setattr(node, key, value)
    assert white_lit(folded(made)) == pytest.approx(white_lit(made), rel=tolerance)


@pytest.mark.parametrize("make", [
    lambda: mixed("Emission", "BsdfTransparent"), lambda: material("ShaderNodeEmission", Strength=5.0)[0],
    lambda: material("ShaderNodeBsdfDiffuse")[0], lambda: material()[0], lambda: material("ShaderNodeHoldout")[0]])
def test_what_is_shown_as_it_is_is_not_reported(make):
    report = Report()
    tile_of(make(), report)
    assert not any(word in line for line in report.lines() for word in ("replaced", "reflects", "roughness", "black"))


def test_a_shader_of_eevee_alone_reflects_nothing_as_in_cycles():
    tile, emission = tile_of(material("ShaderNodeEeveeSpecular", Emissive_Color=(1, 1, 1, 1))[0])
    assert not tile[BASE_COLOR].any() and not emission.any()


def test_a_light_that_is_out_is_a_surface_shader_all_the_same():
    report = Report()
    tile_of(material("ShaderNodeEmission", Strength=0.0)[0], report)
    assert report.lines() == []
