# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of packages that are missing: what renders without them, and why they cannot be installed."""
import platform
import re

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.preferences import package_panel, preferences
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import packages

from tests.rf2_engine.layout import Layout

OFFLINE = "Allow Online Access in Preferences > System first"


@pytest.fixture
def missing(scene, monkeypatch):  # with an empty scene, because a test before may have left the add-on disabled
    """Function after which the running Python has all packages but these, and our folder has none."""
    found = packages.elsewhere

    def lacks(*names):
        monkeypatch.setattr(packages, "elsewhere", lambda name: None if name in names else found(name))
    bpy.context.preferences.system.use_online_access = True
    yield lacks
    bpy.context.preferences.system.use_online_access = False


def drawn():
    layout = Layout()
    package_panel.draw_packages(layout, packages.PACKAGES)
    return " ".join(layout.texts), len(layout.operators)


def test_without_fast_simplification_small_scenes_render(missing):
    missing("fast_simplification")
    assert "Scenes whose meshes fit into Max Triangles render without it" in drawn()[0]
    missing("fast_simplification", "torch")
    assert "Max Triangles" not in drawn()[0]


def test_a_greyed_button_has_its_reason_below(missing, monkeypatch):
    missing("torch")
    assert drawn() == ("Missing Python packages: torch", 1)
    bpy.context.preferences.system.use_online_access = False
    assert drawn() == (f"Missing Python packages: torch {OFFLINE}", 1)
    bpy.context.preferences.system.use_online_access = True
    monkeypatch.setattr(packages, "is_extension", lambda: False)
    assert "runs from its source folder" in drawn()[0]


def test_a_computer_that_packages_are_not_made_for_is_told_what_to_do_and_has_no_button(missing, monkeypatch):
    missing("torch")
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    text, buttons = drawn()
    assert text.startswith("Missing Python packages: torch torch ") and buttons == 0
    assert re.search(r"is not made for Python 3\.\d+ on \w+ riscv64: use a Blender from blender\.org", text)


def test_the_same_reason_is_not_given_twice(missing):
    bpy.context.preferences.system.use_online_access = False
    addon = bpy.context.preferences.addons.new()
    addon.module = packages.EXTENSION
    chosen = addon.preferences
    for names, given in ((["diffusers"], 0), ([], 1)):  # by the panel of the packages, which stands above
        missing(*names)
        layout = Layout()
        preferences._draw_download(layout, chosen)
        assert layout.texts.count(OFFLINE) == given
