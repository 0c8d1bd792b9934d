# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of packages that are missing: what renders without them, and why they cannot be installed."""
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.preferences import package_operators, package_panel, preferences
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import extension, packages, published_weights, wheels

from tests.rf2_engine.layout import Layout


@pytest.fixture
def missing(scene, monkeypatch):  # with an empty scene, because a test before may have left the add-on disabled
    def lacks(*names):
        monkeypatch.setattr(packages, "missing", lambda group=packages.PACKAGES: list(names))
    return lacks


@pytest.fixture
def preferred():
    """The add-on's preferences."""
    addon = bpy.context.preferences.addons.new()
    addon.module = extension.EXTENSION
    return addon.preferences


def drawn():
    layout = Layout()
    package_panel.draw_packages(layout, packages.PACKAGES)
    return " ".join(layout.texts), len(layout.operators)


@pytest.mark.parametrize("names, expected", [
    (["fast_simplification"], "Missing Python package: fast_simplification Scenes render without it, but slower: "
                              "meshes are simplified in several times the time"),
    (["embreex"], "Missing Python package: embreex Scenes render without it, but slower: rays take ten times as long"),
    (["fast_simplification", "embreex"], "Missing Python packages: fast_simplification, embreex Scenes render without "
     "them, but slower: meshes are simplified in several times the time, rays take ten times as long"),
])
def test_packages_that_scenes_render_without_say_what_they_speed_up(missing, monkeypatch, names, expected):
    monkeypatch.setattr(packages, "unavailable", lambda names: "")
    missing(*names)
    assert drawn()[0].startswith(expected)
    missing("torch", *names)
    assert "Scenes render" not in drawn()[0]


@pytest.mark.parametrize("name, is_offered", [("torch", True), ("embreex", False)])
def test_the_dialog_offers_builds_of_pytorch_where_it_is_downloaded(missing, preferred, monkeypatch, name, is_offered):
    monkeypatch.setattr(wheels, "has_builds", lambda: True)
    monkeypatch.setattr(packages, "required_wheels", lambda names: [wheels.Wheel(n, "1", (), 1, 1) for n in names])
    monkeypatch.setattr(packages, "folder", lambda create=False: Path())
    missing(name)
    layout = Layout()
    dialog = type("Dialog", (), {"layout": layout, "published": False, "bl_label": "Install", "by_content": False} | {
        key: getattr(package_operators.RENDERFORMER_OT_install_packages, key)
        for key in ("problem", "required_wheels", "offers_builds")})()
    operator = package_operators.RENDERFORMER_OT_install_packages
    manager = SimpleNamespace(invoke_props_dialog=lambda *_, **__: {"RUNNING_MODAL"})
    operator.invoke(dialog, SimpleNamespace(window_manager=manager), None)
    operator.draw(dialog, None)
    assert ("torch_build" in layout.shown) == is_offered and name in " ".join(layout.texts)


def test_a_greyed_button_has_its_reason_below(missing, monkeypatch):
    missing("torch")
    monkeypatch.setattr(extension, "offline", lambda: "Enable Allow Online Access first")
    assert drawn() == ("Missing Python package: torch Enable Allow Online Access first", 1)
    monkeypatch.setattr(extension, "offline", lambda: "")
    monkeypatch.setattr(packages, "folder", lambda: None)
    assert "runs from its source folder" in drawn()[0]


def test_a_python_that_packages_are_not_made_for_is_told_what_to_do_and_has_no_button(missing, monkeypatch):
    missing("embreex")

    def refuse(names):
        raise wheels.NoWheel("embreex is not made for Python 3.14: use Blender from blender.org")
    monkeypatch.setattr(packages, "required_wheels", refuse)
    assert drawn() == ("Missing Python package: embreex Scenes render without it, but slower: rays take ten times as "
                       "long embreex is not made for Python 3.14: use Blender from blender.org", 0)


def test_published_weights_that_nobody_asked_for_are_no_warning(missing, monkeypatch, tmp_path):
    monkeypatch.setattr(packages, "missing", lambda group=packages.PACKAGES: (
        ["diffusers"] if group is packages.PUBLISHED else []))
    monkeypatch.setattr(published_weights, "download_folder", lambda: tmp_path / "weights")
    addon = bpy.context.preferences.addons.new()
    addon.module = extension.EXTENSION

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
    monkeypatch.setattr(extension, "offline", lambda: "Enable Allow Online Access first")
    addon = bpy.context.preferences.addons.new()
    addon.module = extension.EXTENSION
    chosen = addon.preferences
    for names, given in ((["diffusers"], 0), ([], 1)):  # by the panel of the packages, which stands above
        missing(*names)
        layout = Layout()
        preferences._draw_download(layout, chosen)
        assert layout.texts.count("Enable Allow Online Access first") == given
