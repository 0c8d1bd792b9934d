# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of packages that are missing: what renders without them, and why they cannot be installed."""
from types import SimpleNamespace

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.preferences import package_panel, preferences
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import packages, published_weights, wheels

from tests.rf2_engine.layout import Layout


@pytest.fixture
def missing(scene, monkeypatch):  # with an empty scene, because a test before may have left the add-on disabled
    def lacks(*names):
        monkeypatch.setattr(packages, "missing", lambda group=packages.PACKAGES: list(names))
    return lacks


def drawn():
    layout = Layout()
    package_panel.draw_packages(layout, packages.PACKAGES)
    return " ".join(layout.texts), len(layout.operators)


def test_without_fast_simplification_scenes_render(missing):
    missing("fast_simplification")
    assert "Scenes render without it" in drawn()[0]
    missing("fast_simplification", "torch")
    assert "Scenes render" not in drawn()[0]


def test_a_greyed_button_has_its_reason_below(missing, monkeypatch):
    missing("torch")
    monkeypatch.setattr(packages, "offline", lambda: "Enable Allow Online Access first")
    assert drawn() == ("Missing Python packages: torch Enable Allow Online Access first", 1)
    monkeypatch.setattr(packages, "offline", lambda: "")
    monkeypatch.setattr(packages, "folder", lambda: None)
    assert "runs from its source folder" in drawn()[0]


def test_a_python_that_packages_are_not_made_for_is_told_what_to_do_and_has_no_button(missing, monkeypatch):
    missing("embreex")

    def refuse(names):
        raise wheels.NoWheel("embreex is not made for Python 3.14: use Blender from blender.org")
    monkeypatch.setattr(packages, "required_wheels", refuse)
    assert drawn() == ("Missing Python packages: embreex "
                       "embreex is not made for Python 3.14: use Blender from blender.org", 0)


def test_published_weights_that_nobody_asked_for_are_no_warning(missing, monkeypatch, tmp_path):
    monkeypatch.setattr(packages, "missing", lambda group=packages.PACKAGES: (
        ["diffusers"] if group is packages.PUBLISHED else []))
    monkeypatch.setattr(published_weights, "download_folder", lambda: tmp_path / "weights")
    addon = bpy.context.preferences.addons.new()
    addon.module = packages.EXTENSION

    def drawn_preferences():
        layout = Layout()
        ours = preferences.RenderFormerPreferences
        ours.draw(SimpleNamespace(layout=layout, weights_folder="", bl_rna=ours.bl_rna), None)
        return layout
    layout = drawn_preferences()
    assert "Published weights: not downloaded (optional)" in layout.texts and "ERROR" not in layout.icons
    (tmp_path / "weights").mkdir()  # a download was begun
    assert "ERROR" in drawn_preferences().icons


def test_the_same_reason_is_not_given_twice(missing, monkeypatch):
    monkeypatch.setattr(packages, "offline", lambda: "Enable Allow Online Access first")
    addon = bpy.context.preferences.addons.new()
    addon.module = packages.EXTENSION
    chosen = addon.preferences
    for names, given in ((["diffusers"], 0), ([], 1)):  # by the panel of the packages, which stands above
        missing(*names)
        layout = Layout()
        preferences._draw_download(layout, chosen)
        assert layout.texts.count("Enable Allow Online Access first") == given
