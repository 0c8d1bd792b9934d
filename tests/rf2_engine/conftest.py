# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the extension, installs that zip into a temporary user repository and enables it: what users get.

Test modules import the add-on's own modules as `from bl_ext.user_default.renderformer_v2.rf2_engine import ...`.
"""
import gc
import os
from pathlib import Path

import bpy
import pytest

import addon_utils  # bpy puts it on the path

from tests.rf2_engine.installed import PACKAGE
from tools.build import build


def _install() -> None:
    archive = build(Path(os.environ["BLENDER_USER_RESOURCES"]) / "build")
    addon_utils.enable("bl_pkg", default_set=True)
    bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    if PACKAGE not in bpy.context.preferences.addons:
        raise RuntimeError(f"Blender did not enable {PACKAGE}")


_install()


@pytest.fixture
def few_rays(monkeypatch):
    """Estimates of light take a sixth of their rays and patches: quick and noisy, for tests that are not about the
    quality.

    A module whose tests are about it overrides this fixture with one that does nothing.
    """
    from bl_ext.user_default.renderformer_v2.model.light.bounce import patches
    from bl_ext.user_default.renderformer_v2.model.light.effort import Effort
    monkeypatch.setattr(patches, "PATCHES", patches.PATCHES // 6)
    monkeypatch.setattr(Effort, "of", lambda self, count, of=Effort.of: of(self, count / 6))
    monkeypatch.setattr(Effort, "of_picture", lambda self, pixels: self)


@pytest.fixture
def scene(few_rays):
    """An empty scene that renders with our engine: tiny, one guide sample, a grey world, a camera at (0, -5, 0)."""
    addon_utils.disable(PACKAGE, default_set=True)  # factory settings do so with every add-on, which takes longer
    gc.freeze()  # the add-on has just collected all garbage, and does so after each test: modules are left out then
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    addon_utils.enable(PACKAGE)
    scene = bpy.context.scene
    scene.render.engine = "RENDERFORMER_V2"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 50, 37, 100
    scene.renderformer_v2.guide_samples, scene.renderformer_v2.use_adaptive_sampling = 1, False
    scene.renderformer_v2.precision = "fp32"
    scene.renderformer_v2.max_edge = 1  # few triangles: these tests are not about the picture's quality
    scene.world = bpy.data.worlds.new("Grey")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.25, 0.25, 0.25, 1)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -5, 0), (1.5707963, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


@pytest.fixture
def lit(scene):
    """A cube in the sun, with a reference of 4 samples that is not denoised."""
    from tests.rf2_engine.f12 import cube, material, sun
    cube(scene, of=material("Red", (0.8, 0.05, 0.05))).rotation_euler = (0.3, 0.2, 0.5)
    sun(scene)
    chosen = scene.renderformer_v2.reference
    chosen.use, chosen.samples, chosen.use_denoising = True, 4, False
    return scene


@pytest.fixture
def still_life(scene):
    """The scene, with things of which every pass has something to say (still_life.py)."""
    from tests.rf2_engine.still_life import build  # it imports the extension that is installed above
    build(scene)
    return scene
