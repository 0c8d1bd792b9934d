# SPDX-License-Identifier: GPL-3.0-or-later
"""A package index of our own, and an empty folder of packages that is filled from it."""
import sys

import bpy
import pytest

import addon_utils  # bpy puts it on the path

from tests.rf2_engine.installed import PACKAGE
from tests.rf2_engine.setup.index import NAMES, Index


@pytest.fixture
def index(monkeypatch):
    """An index with both packages, whose hashes are the pinned ones."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.setup import package_install, wheels  # once it is installed
    server = Index(tiny_one="1.0", tiny_two="2.0")
    for variable in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
        monkeypatch.delenv(variable, raising=False)
    pins = server.pins()
    monkeypatch.setattr(wheels, "pins", lambda: pins)
    yield server
    package_install.current.forget()
    server.stop()


@pytest.fixture
def target(scene, index, monkeypatch, tmp_path):
    """Our folder of packages, empty; the add-on asks the index for NAMES."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.setup import extension, package_install, packages
    monkeypatch.setattr(packages, "PACKAGES", NAMES)
    monkeypatch.setattr(packages, "PUBLISHED", {})
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path / "runtime")
    monkeypatch.setattr(sys, "path", [*sys.path])
    addon_utils.enable(PACKAGE, default_set=True)
    bpy.context.preferences.system.use_online_access = True
    extension.preferences().package_index = index.address
    packages.refresh()
    yield tmp_path / "runtime"
    package_install.current.forget()
    packages.refresh()
    extension.preferences().package_index = ""
    bpy.context.preferences.system.use_online_access = False
    for name in NAMES:
        sys.modules.pop(name, None)
