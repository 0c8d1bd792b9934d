# SPDX-License-Identifier: GPL-3.0-or-later
"""The pinned wheels: one list for every system that Blender runs on, and no numpy."""
import platform
import re
import sys
from collections import namedtuple

import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.preferences import package_panel, preferences
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import extension, packages, wheels

from tests.rf2_engine.layout import Layout
from tools.extension import ROOT

Version = namedtuple("Version", "major minor")
SYSTEMS = [("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "arm64"), ("win32", "AMD64")]
WITHOUT_EMBREE = ("linux", "aarch64")


@pytest.fixture
def on(scene, monkeypatch):  # with an empty scene, because a test before may have left the add-on disabled
    def become(system: str, machine: str, minor: int) -> None:
        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setattr(platform, "machine", lambda: machine)
        monkeypatch.setattr(sys, "version_info", Version(3, minor))
    return become


@pytest.mark.parametrize("system, machine", SYSTEMS)
@pytest.mark.parametrize("minor", [11, 13, 14])
def test_everything_is_there_with_hashes_for_this_system(on, system, machine, minor):
    on(system, machine, minor)
    known = packages.PACKAGES | packages.PUBLISHED
    offered = {name for name, distribution in known.items() if packages.is_offered(name, distribution)}
    assert known.keys() - offered == ({"embreex"} if (system, machine) == WITHOUT_EMBREE else set())
    for distribution in (known[name] for name in offered):
        index_build = "CPU" if system == "win32" else "CUDA"  # the other is PyTorch's own index's
        found = {wheel.name: wheel for wheel in wheels.find_wheels(distribution, index_build)}
        assert distribution in found and all(re.fullmatch("[0-9a-f]{64}", value) for wheel in found.values()
                                             for value in wheel.sha256 or [""])
        assert "numpy" not in found
    torch = {wheel.name for wheel in wheels.find_wheels("torch")}
    assert ("nvidia-cudnn-cu13" in torch) == (system == "linux") and "jinja2" in torch


@pytest.mark.parametrize("system, machine", SYSTEMS)
def test_linux_and_windows_have_two_builds_of_pytorch(on, system, machine):
    on(system, machine, 11)
    cuda, cpu = wheels.find_wheels("torch"), wheels.find_wheels("torch", "CPU")
    assert (cuda != cpu) == wheels.has_builds() == (system in ("linux", "win32"))
    if system == "win32":  # that of the package index knows no CUDA
        (own,) = [wheel for wheel in wheels.find_wheels("torch", "CUDA", "cu126") if wheel.name == "torch"]
        assert own.version.endswith("+cu126") and not own.sha256 and all(wheel.sha256 for wheel in cpu)
        assert not any(wheel.name.startswith("nvidia") for wheel in cuda)
    if system == "linux":
        assert {wheel.name for wheel in cpu if not wheel.sha256} == {"torch"}
        assert wheels.space_needed(cpu) < 1.5e9 < 5e9 < wheels.space_needed(cuda)


def test_where_a_useful_package_is_not_made_the_others_are_installed(on, monkeypatch, tmp_path):
    on(*WITHOUT_EMBREE, 11)
    monkeypatch.setattr(packages, "is_elsewhere", lambda name: False)
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path)
    names = packages.missing()
    assert names == ["torch", "safetensors", "fast_simplification"]
    assert {"torch", "fast-simplification"} <= {wheel.name for wheel in packages.missing_wheels(packages.PACKAGES)}


def test_a_system_without_a_wheel_is_named(on):
    on("darwin", "x86_64", 11)
    with pytest.raises(wheels.NoWheel, match="torch .* is not made for Python 3.11 on"):
        wheels.find_wheels("torch")


@pytest.mark.parametrize("has_folder", [True, False])
def test_the_button_is_advised_only_where_it_has_a_folder(monkeypatch, tmp_path, has_folder):
    """Without one, from the source tree, pip is."""
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path if has_folder else None)
    monkeypatch.setattr(packages, "missing", lambda: ["torch"])
    monkeypatch.setattr(packages, "too_old", lambda: "")
    with pytest.raises(packages.MissingPackages, match="-m pip install torch==") as raised:
        packages.require()
    assert ("Install Packages" in str(raised.value)) == has_folder


@pytest.mark.parametrize("version", [11, 99])
def test_what_is_too_old_is_replaced_by_the_button_only_where_its_wheel_is_made(on, monkeypatch, tmp_path, version):
    monkeypatch.setattr(packages, "elsewhere", lambda name: tmp_path if name == "torch" else None)
    monkeypatch.setattr(packages, "version_elsewhere", lambda name: "2.3" if name == "torch" else "")
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path)
    on("linux", "x86_64", version)
    assert ("Install Packages" in packages.too_old()) == (version == 11)


def drawn(monkeypatch, tmp_path, missing=lambda name: True) -> Layout:
    monkeypatch.setattr(packages, "is_elsewhere", lambda name: not missing(name))
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path)
    layout = Layout()
    package_panel.draw_packages(layout, packages.PACKAGES)
    return layout


def test_a_python_without_wheels_is_named_instead_of_a_button_that_leads_nowhere(on, monkeypatch, tmp_path):
    on("linux", "x86_64", 15)
    layout = drawn(monkeypatch, tmp_path)
    assert "Python 3.15" in " ".join(layout.texts) and "blender.org" in " ".join(layout.texts)
    assert not layout.operators
    with pytest.raises(packages.MissingPackages, match="Python 3.15"):
        packages.require()


def test_a_greyed_button_has_its_reason_below_it(on, monkeypatch, tmp_path):
    on("linux", "x86_64", 11)
    monkeypatch.setattr(extension, "offline", lambda: "Allow Online Access in Preferences > System first")
    layout = drawn(monkeypatch, tmp_path)
    assert layout.operators and any("Allow Online Access" in text for text in layout.texts)
    monkeypatch.setattr(extension, "offline", lambda: "")
    assert not any("Allow Online Access" in text for text in drawn(monkeypatch, tmp_path).texts)


@pytest.mark.parametrize("missing, told", [({"fast_simplification"}, True), ({"torch", "fast_simplification"}, False)])
def test_without_the_simplifier_alone_scenes_render(on, monkeypatch, tmp_path, missing, told):
    on("linux", "x86_64", 11)
    text = " ".join(drawn(monkeypatch, tmp_path, missing.__contains__).texts)
    assert ("render without it" in text) == told


@pytest.mark.parametrize("system, driver, expected",
                         [("linux", True, "CUDA"), ("linux", False, "CPU"), ("win32", True, "CUDA"),
                          ("win32", False, "CPU"), ("darwin", False, "CUDA")])
def test_automatic_is_cuda_where_a_driver_is_found(on, monkeypatch, system, driver, expected):
    on(system, "AMD64" if system == "win32" else "x86_64", 11)
    monkeypatch.setattr(wheels, "has_nvidia_driver", lambda: driver)
    assert wheels.choose_build("AUTO") == expected
    assert wheels.choose_build("CUDA") == "CUDA" and wheels.choose_build("CPU") == "CPU"


@pytest.mark.parametrize("text, expected", [
    ("__version__ = '2.15.0+cu132'\ncuda: Optional[str] = '13.2'\nhip: Optional[str] = None\n", "CUDA 13.2"),
    ("__version__ = '2.15.0+cpu'\ncuda: Optional[str] = None\nhip: Optional[str] = None\n", "CPU"),
    ("cuda: Optional[str] = None\nhip: Optional[str] = '7.1.2'\n", "ROCm 7.1.2"), (None, "")])
def test_the_build_that_is_installed_is_read_from_its_files(monkeypatch, tmp_path, text, expected):
    monkeypatch.setattr(packages, "elsewhere", lambda name: None)
    monkeypatch.setattr(packages, "folder", lambda create=False: tmp_path)
    if text is not None:
        (tmp_path / "torch").mkdir()
        (tmp_path / "torch" / "version.py").write_text(text)
    assert packages.installed_build() == expected


def test_the_address_of_pytorchs_index_names_the_release_of_cuda(scene):
    default = preferences.RenderFormerPreferences.bl_rna.properties["torch_cuda_index"].default
    assert wheels.parse_cuda_release(default) == wheels.CUDA
    assert wheels.parse_cuda_release("https://a.b/whl/cu126/") == "cu126"


def test_the_versions_are_those_that_the_tests_run_with():
    tested = dict(line.lower().replace("_", "-").split("==") for line in
                  (ROOT / "requirements.txt").read_text().splitlines() if "==" in line and line[0] != "#")
    for distribution in (packages.PACKAGES | packages.PUBLISHED).values():
        version = wheels.pins()["wheels"][distribution]["version"]
        assert tested.get(distribution, version) == version
