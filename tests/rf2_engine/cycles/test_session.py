# SPDX-License-Identifier: GPL-3.0-or-later
"""Traced hints: shadows and mirrors are there, bounced light is not, and the published network never sees them."""
from pathlib import Path

import bpy
import numpy as np
import pytest

import cycles.engine as cycles_engine
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import run as cycles_run
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session_overrides
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits as first_hits
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.first_hits import make_guides
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings, Light
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.cycles_text import EngineText

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12

RED = (0.8, 0.02, 0.02)


def light(scene, rotation):
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 4, rotation
    scene.collection.objects.link(sun)


@pytest.fixture
def guides(monkeypatch):
    """The guides of the last F12."""
    seen = []

    def spy(passes, converted, view):
        seen.append(make_guides(passes, converted, view))
        return seen[-1]

    monkeypatch.setattr(first_hits, "make_guides", spy)
    return seen


@pytest.fixture
def shadowed(scene):
    """A wall behind the scene with a cube in front of it, lit from the camera's left; the world is black."""
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    mesh_object(scene, "Wall", [(-6, 3, -4), (6, 3, -4), (6, 3, 4), (-6, 3, 4)], [(0, 1, 2, 3)])
    cube(scene, location=(-1, 0, 0))
    light(scene, (1.5707963, 0, -0.6))
    scene.renderformer_v2.guide_samples = 8
    return scene


def test_a_cast_shadow_is_in_the_picture_and_gone_without_hints(shadowed, tmp_path, guides):
    hinted = press_f12(shadowed, tmp_path)["ViewLayer.Combined"][..., :3].mean(-1)
    traced = guides[-1].traced.mean(-1)
    wall = guides[-1].position[..., 1] > 2.9
    shadow = wall & (traced < 0.05 * traced[wall].max())
    lit = wall & (traced > 0.7 * traced[wall].max())
    assert shadow.sum() > 30 and lit.sum() > 100
    assert hinted[shadow].mean() < 0.4 * hinted[lit].mean()
    shadowed.renderformer_v2.light = "NETWORK"
    press_f12(shadowed, tmp_path)
    assert guides[-1].traced is None


def test_what_is_traced_has_not_bounced_diffusely(scene, tmp_path, guides):
    """A floor in the dark beside a wall in the sun: Cycles lights it by one bounce, the hints do not."""
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    mesh_object(scene, "Wall", [(-3, 2, -1), (3, 2, -1), (3, 2, 3), (-3, 2, 3)], [(0, 1, 2, 3)], material("Red", RED))
    matt = material("Matt")
    matt.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0
    mesh_object(scene, "Floor", [(-3, -3, -1), (3, -3, -1), (3, 2, -1), (-3, 2, -1)], [(0, 1, 2, 3)], matt)
    light(scene, (1.5707963, 0, 0))  # along the floor
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    floor = (guides[-1].normal[..., 2] > 0.9) & (guides[-1].alpha > 0.9)
    assert floor.any() and guides[-1].traced[floor].max() < 0.02  # the sun has a width
    red, green, _ = picture[floor][:, :3].mean(0)
    assert red > 2 * green and red > 5 * guides[-1].traced[floor].mean()  # its prior knows that light


def test_a_mirror_shows_its_neighbour(scene, tmp_path, guides):
    mirror = material("Mirror")
    shader = mirror.node_tree.nodes["Principled BSDF"]
    shader.inputs["Metallic"].default_value, shader.inputs["Roughness"].default_value = 1, 0
    mesh_object(scene, "Mirror", [(-3, 2, -3), (3, 2, -3), (3, 2, 3), (-3, 2, 3)], [(0, 1, 2, 3)], mirror)
    cube(scene, location=(0, -9, 0), of=material("Red", RED))  # behind the camera
    light(scene, (-1.3, 0, 0))
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    reflected = picture[15:22, 20:30, :3].mean((0, 1))
    around = picture[:4, :4, :3].mean((0, 1))
    assert reflected[0] > 3 * reflected[1] and abs(around[0] - around[1]) < 0.2 * around[0]


def test_glass_shows_what_is_behind_it(scene, tmp_path):
    glass = material("Glass", (1, 1, 1))
    shader = glass.node_tree.nodes["Principled BSDF"]
    shader.inputs["Transmission Weight"].default_value, shader.inputs["Roughness"].default_value = 1, 0
    mesh_object(scene, "Pane", [(-0.8, -1, -0.8), (0.8, -1, -0.8), (0.8, -1, 0.8), (-0.8, -1, 0.8)], [(0, 1, 2, 3)],
                glass)
    mesh_object(scene, "Wall", [(-6, 4, -6), (6, 4, -6), (6, 4, 6), (-6, 4, 6)], [(0, 1, 2, 3)], material("Red", RED))
    light(scene, (1.3, 0, 0))
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    behind, beside = picture[16:21, 22:28, :3].mean((0, 1)), picture[:4, :4, :3].mean((0, 1))
    assert behind[0] > 4 * behind[1] and behind[0] > 0.5 * beside[0]


def test_the_published_network_is_never_guided(scene, tmp_path):
    bundle = tmp_path / "renderformer-v2"
    bundle.mkdir()
    (bundle / "model_index.json").write_text("{}")
    settings = scene.renderformer_v2
    settings.light, settings.weights_source = "TRACED", "BUNDLED"
    assert FrameSettings.read(scene).light is Light.TRACED
    settings.weights_source, settings.weights_folder = "FOLDER", str(bundle)
    assert FrameSettings.read(scene).light is Light.NONE
    settings.weights_source, settings.light = "BUNDLED", "NETWORK"
    assert FrameSettings.read(scene).light is Light.NONE


def test_a_blender_without_a_denoiser_says_so_and_shows_hardly_more_noise(shadowed, tmp_path, guides, monkeypatch):
    """Of a sun with a wide penumbra."""
    shadowed.renderformer_v2.guide_samples = 2
    for sun in bpy.data.lights:
        sun.angle = 1.5
    picture = press_f12(shadowed, tmp_path)["ViewLayer.Combined"]
    monkeypatch.setattr(compat, "has_openimagedenoise", lambda: False)
    noise = press_f12(shadowed, tmp_path)["ViewLayer.Combined"] - picture
    denoised, noisy = (g.traced[5:-5, 5:-5] for g in guides)
    assert noise[5:-5, 5:-5, :3].std() < 0.08 * (noisy - denoised).std()
    assert noisy.mean() == pytest.approx(denoised.mean(), rel=0.1)
    assert not np.array_equal(noisy, denoised)
    assert any("OpenImageDenoise" in line for line in last_render.last_frame[-1].report)


def test_traced_light_leaves_the_scene_as_it_was(scene, tmp_path):
    scene.render.use_persistent_data = True
    scene.cycles.diffuse_bounces, scene.cycles.use_denoising = 3, False
    cube(scene)
    before = {name: getattr(scene.cycles, name) for name in ("diffuse_bounces", "use_denoising", "denoiser", "seed")}
    first = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert {name: getattr(scene.cycles, name) for name in before} == before
    scene.render.engine = "CYCLES"
    bpy.ops.render.render(scene=scene.name)  # with the bounces of the scene, not ours
    scene.render.engine = "RENDERFORMER_V2"
    np.testing.assert_allclose(press_f12(scene, tmp_path)["ViewLayer.Combined"], first, atol=0.02)


def test_tiles_of_large_pictures_change_nothing_and_leave_no_file_after_esc(shadowed, tmp_path, monkeypatch):
    shadowed.render.resolution_x, shadowed.render.resolution_y = 300, 40
    whole = press_f12(shadowed, tmp_path)
    monkeypatch.setattr(session_overrides, "PIXELS_PER_THREAD", 100)
    texts = []

    def read(text, real=EngineText.read):
        texts.append(real(text))
        return texts[-1]
    monkeypatch.setattr(EngineText, "read", read)
    tiled = press_f12(shadowed, tmp_path)
    assert any("Tiles" in text for text in texts)
    for name, pixels in whole.items():
        np.testing.assert_allclose(tiled[name], pixels, atol=1e-3)

    def finish(*_):
        raise RenderCancelled()
    monkeypatch.setattr(cycles_engine, "render_frame_finish", finish)  # nobody can press Esc without a window
    press_f12(shadowed, tmp_path)
    left = [*Path(bpy.app.tempdir).glob("cycles-tile-buffer-*")]
    assert len(left) == 1
    cycles_run._forget_tiles()
    assert not left[0].exists()


def test_fog_is_as_bright_and_as_smooth_as_that_of_cycles(scene, tmp_path):
    fog = material("Fog")
    tree = fog.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    medium = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(medium.outputs["Volume"], tree.nodes["Material Output"].inputs["Volume"])
    cube(scene, of=fog)
    mesh_object(scene, "Wall", [(-6, 3, -4), (6, 3, -4), (6, 3, 4), (-6, 3, 4)], [(0, 1, 2, 3)])
    light(scene, (0.9, 0.3, 0))
    scene.renderformer_v2.guide_samples = 8
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples = True, 128
    passes = press_f12(scene, tmp_path)
    ours, cycles = (passes[f"ViewLayer.{name}"][12:25, 19:31, :3].mean(-1) for name in ("Combined", "Cycles Reference"))
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.15)
    grain = [np.abs(np.diff(picture, 2, axis=1)).mean() / picture.mean() for picture in (ours, cycles)]
    assert grain[0] < 2 * grain[1] + 0.01


def test_a_small_bright_emitter_shines_once(scene, tmp_path):
    """The denoiser smooths its edge, which the pass Emission does not have."""
    cube(scene, of=material("Floor")).scale = (20, 20, 0.01)
    shining = material("Shining")
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 1000
    small = cube(scene, of=shining)
    small.scale, small.location = (0.03, 0.03, 0.03), (0, 0, 0.6)
    scene.camera.location, scene.camera.rotation_euler = (0, -4, 1.5), (1.3, 0, 0)
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.renderformer_v2.guide_samples = 8
    scene.view_layers[0].use_pass_emit = True
    rendered = press_f12(scene, tmp_path)
    emission = next(pixels for name, pixels in rendered.items() if name.startswith("ViewLayer.Emi"))[..., :3]
    assert 1 < emission.sum(axis=(0, 1)).min() / 1000 < 20
    assert (rendered["ViewLayer.Combined"][..., :3] - emission).max() < 0.1 * 1000


def test_metal_that_a_glowing_strip_lies_on_shines_as_in_cycles(scene, tmp_path):
    """It is far brighter than all that is a few pixels away."""
    metal, glowing = material("Metal"), material("Glowing")
    metal.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = 1
    metal.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.3
    glowing.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 12
    wall, shelf, strip = cube(scene, of=metal), cube(scene, of=metal), cube(scene, of=glowing)
    wall.scale, wall.location = (6, 0.1, 6), (0, 0.15, 0)
    shelf.scale, shelf.location = (6, 0.2, 0.04), (0, 0, -0.04)
    strip.scale, strip.location = (6, 0.1, 0.03), (0, 0.05, 0)
    scene.camera.location, scene.camera.rotation_euler = (0, -4, 0.6), (1.42, 0, 0)
    scene.render.resolution_x, scene.render.resolution_y = 48, 48
    scene.renderformer_v2.guide_samples = 32
    scene.view_layers[0].use_pass_emit = True
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples = True, 128
    rendered = press_f12(scene, tmp_path)
    emission = next(pixels for name, pixels in rendered.items() if name.startswith("ViewLayer.Emi"))[..., :3]
    pictures = (rendered[f"ViewLayer.{name}"][..., :3] for name in ("Combined", "Cycles Reference"))
    ours, cycles = ((picture - emission).sum() for picture in pictures)
    assert cycles > 0.1 * emission.sum()
    assert ours == pytest.approx(cycles, rel=0.15)


@pytest.mark.parametrize("chosen", ["TRACED", "NETWORK"])
def test_a_surface_whose_normal_is_no_number_looks_as_in_cycles(scene, tmp_path, chosen):
    """Black; from Blender 5.0 on a Normal Map of this colour leaves normals as they are."""
    of = material("Normal of 0")
    tree = of.node_tree
    zero = tree.nodes.new("ShaderNodeNormalMap")
    zero.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1)
    tree.links.new(zero.outputs[0], tree.nodes["Principled BSDF"].inputs["Normal"])
    cube(scene, of=of)
    scene.renderformer_v2.light, scene.render.resolution_x, scene.render.resolution_y = chosen, 32, 32
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples = True, 16
    rendered = press_f12(scene, tmp_path)
    ours, cycles = (rendered[f"ViewLayer.{name}"][16, 16, :3] for name in ("Combined", "Cycles Reference"))
    assert cycles.max() == 0 or bpy.app.version >= (5, 0, 0)
    np.testing.assert_allclose(ours, cycles, atol=0.005 * (cycles.max() > 0))
