# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview panels and icons show a picture by the bundled network, and never disturb a frame or the user."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import model_cache, preview, render, statistics

from .f12 import cube, material, press_f12


@pytest.fixture
def drawn():
    """A function that makes Blender draw the preview of a data-block anew and gives its pixels."""
    def pixels(data) -> np.ndarray:
        data.preview_ensure()
        bpy.ops.wm.previews_clear(id_type={"MATERIAL", "LIGHT", "WORLD"})
        bpy.ops.wm.previews_ensure()
        width, height = data.preview.image_size
        return np.array(data.preview.image_pixels_float).reshape(height, width, 4)
    return pixels


def test_a_material_is_drawn_in_its_colour(scene, drawn):
    red, green = material("Red", (0.8, 0.02, 0.02)), material("Green", (0.02, 0.8, 0.02))
    cube(scene, of=red)
    cube(scene, "Other", of=green)
    of_red, of_green = drawn(red), drawn(green)
    centre = np.s_[50:80, 50:80]
    assert of_red.shape == (128, 128, 4)
    assert of_red[centre][..., 0].mean() > 1.3 * of_red[centre][..., 1].mean()
    assert of_green[centre][..., 1].mean() > 1.3 * of_green[centre][..., 0].mean()


def test_a_world_is_drawn(scene, drawn):
    assert drawn(scene.world)[..., :3].max() > 0.05


def test_previews_are_not_in_last_render_and_leave_its_network_alone(scene, drawn, tmp_path):
    cube(scene)
    press_f12(scene, tmp_path)
    before, cached = list(statistics.last_frame), dict(model_cache._cached)
    drawn(scene.objects["Cube"].active_material)
    assert statistics.last_frame == before and model_cache._cached == cached


def test_previews_are_by_the_bundled_network_whatever_the_scene_has_chosen(scene, drawn, monkeypatch):
    used = []

    def draw(*arguments, real=render.draw, **options):
        done = real(*arguments, **options)
        used.append((done.weights, options["networks"]))
        return done
    monkeypatch.setattr(render, "draw", draw)
    scene.renderformer_v2.weights_source, scene.renderformer_v2.weights_folder = "FOLDER", "/nowhere"
    cube(scene)
    drawn(scene.objects["Cube"].active_material)
    assert used and {weights for weights, _ in used} == {"rf2_small"} and {keeper for _, keeper in used} == {preview}


def test_a_preview_that_fails_says_nothing(scene, drawn, monkeypatch, capfd):
    def fail(*_, **__):
        raise RuntimeError("not for the user")
    monkeypatch.setattr(render, "draw", fail)
    cube(scene)
    assert drawn(scene.objects["Cube"].active_material)[..., :3].max() == 0
    said = capfd.readouterr()
    assert "not for the user" not in said.out + said.err


def test_previews_wait_while_a_frame_renders(scene, drawn, tmp_path, monkeypatch):
    monkeypatch.setattr(preview.running, "is_under_way", lambda: True)
    cube(scene)
    assert drawn(scene.objects["Cube"].active_material)[..., :3].max() == 0
