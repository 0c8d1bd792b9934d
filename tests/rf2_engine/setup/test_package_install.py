# SPDX-License-Identifier: GPL-3.0-or-later
"""Installing packages with Blender's pip from a local index: what lies on disk then, and after every kind of end."""
import importlib
import os
import subprocess
import sys
import time
import venv

import bpy
import pytest

import addon_utils  # bpy puts it on the path
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import (
    display,
    distributions,
    package_install,
    packages,
    wheels,
)

from tests.rf2_engine.installed import PACKAGE
from tests.rf2_engine.setup.index import NAMES, Index, wheel

SETUP = os.path.dirname(package_install.__file__)


def wanted() -> list[wheels.Wheel]:
    return [found for name in NAMES.values() for found in wheels.find_wheels(name)]


def installation(index, folder, **options) -> package_install.Installation:
    return package_install.Installation(folder, wanted(), index=index.address, **options)


def stalled(index, folder, name="tiny-two") -> package_install.Installation:
    """An installation in the middle of a file, for which no more data come."""
    index.stalling = name
    begun = package_install.current.begin(folder, wanted(), index=index.address)
    assert index.stalled.wait(600)
    return begun


def finished(begun: package_install.Installation) -> package_install.Installation:
    begun.wait(600)
    return begun


def tidied(folder) -> bool:
    """Whether the temporary folder is gone, soon."""
    deadline = time.monotonic() + 120
    while (folder / distributions.STAGING).exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return not (folder / distributions.STAGING).exists()


def missing() -> list[str]:
    return packages.missing(NAMES)


def test_what_is_missing_is_installed_and_found_without_numpy(index, target):
    assert missing() == list(NAMES)
    assert bpy.ops.renderformer_v2.install_packages() == {"FINISHED"}
    assert not missing() and importlib.import_module("tiny_two").value == "tiny-two 2.0"
    assert distributions.find_intact(target, by_content=True) == {"tiny-one": "1.0", "tiny-two": "2.0"}
    assert sorted(path.name for path in (target / "shared_space").iterdir()) == ["tiny_one.py", "tiny_two.py"]
    assert tidied(target) and not any("numpy" in path for path in index.requests)
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.renderformer_v2.install_packages()


@pytest.mark.parametrize("damage", [
    lambda folder: (folder / "tiny_one" / "data.bin").unlink(),
    lambda folder: (folder / "tiny_one" / "data.bin").write_bytes(b"x"),
    lambda folder: (folder / "tiny_one-1.0.dist-info" / "RECORD").unlink(),
    lambda folder: (folder / "tiny_one-1.0.dist-info" / "RECORD").write_text("tiny_one/__init__.py,,\n"),
], ids=["a file is lost", "a file is cut off", "the list is lost", "the list is cut off"])
def test_a_half_copied_package_is_missing_and_installed_again(index, target, damage):
    bpy.ops.renderformer_v2.install_packages()
    damage(target)
    packages.refresh()
    assert missing() == ["tiny_one"]
    index.requests.clear()
    assert bpy.ops.renderformer_v2.install_packages() == {"FINISHED"}
    assert not missing() and index.downloads() == ["tiny_one"]


def test_a_folder_without_a_list_of_its_files_is_no_package(index, target):
    (target / "tiny_one").mkdir(parents=True)
    (target / "tiny_one" / "__init__.py").write_text("")
    assert missing() == list(NAMES)


def test_repair_finds_damage_that_only_the_content_shows(index, target):
    bpy.ops.renderformer_v2.install_packages()
    (target / "tiny_two" / "data.bin").write_text("y" * 200_000)
    packages.refresh()
    index.requests.clear()
    assert not missing() and bpy.ops.renderformer_v2.repair_packages() == {"FINISHED"}
    assert index.downloads() == ["tiny_two"]
    assert (target / "tiny_two" / "data.bin").read_text() == "x" * 200_000


def test_another_version_takes_the_place_of_the_old_one(index, target, monkeypatch):
    bpy.ops.renderformer_v2.install_packages()
    (target / "tiny_one" / "mine.txt").write_text("not from the wheel")
    index.wheels = {("tiny-one", "1.1"): wheel("tiny-one", "1.1"), ("tiny-two", "2.0"): wheel("tiny-two", "2.0")}
    pins = index.pins()
    monkeypatch.setattr(wheels, "pins", lambda: pins)
    assert missing() == ["tiny_one"]
    bpy.ops.renderformer_v2.install_packages()
    assert not missing() and not list(target.glob("tiny_one-1.0*"))
    assert (target / "shared_space" / "tiny_two.py").exists() and (target / "tiny_one" / "mine.txt").exists()


def test_cancelling_tidies_up_and_keeps_what_is_complete(index, target):
    begun = stalled(index, target)
    assert 0 < begun.present < begun.total and "tiny-two" in begun.text
    assert bpy.ops.renderformer_v2.cancel_packages() == {"FINISHED"}
    begun.wait(600)
    assert begun.state == "cancelled" and not (target / distributions.STAGING).exists()
    packages.refresh()
    assert missing() == ["tiny_two"]
    index.stalling = ""
    index.requests.clear()
    assert bpy.ops.renderformer_v2.install_packages() == {"FINISHED"}
    assert index.downloads() == ["tiny_two"] and not missing()


def test_everything_temporary_lies_in_our_folder(index, target, tmp_path, monkeypatch):
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    stalled(index, target)
    deadline = time.monotonic() + 120
    while not (found := list((target / distributions.STAGING).rglob("*.whl"))) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert found and not list(elsewhere.iterdir())


def test_a_second_installation_into_the_same_folder_is_refused(index, target):
    first = stalled(index, target)
    second = finished(installation(index, target))
    assert second.state == "failed" and "another Blender" in second.error
    with pytest.raises(RuntimeError, match="being installed"):
        bpy.ops.renderformer_v2.install_packages()
    assert first.is_running and (target / distributions.STAGING).exists()


def test_opening_a_file_goes_on_and_disabling_the_addon_ends_it(index, target):
    begun = stalled(index, target)
    display.keep_redrawing()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert begun.is_running and bpy.app.timers.is_registered(display.redraw) and display.redraw() > 0
    addon_utils.disable(PACKAGE)
    try:
        assert begun.state == "cancelled" and tidied(target)
        assert not bpy.app.timers.is_registered(display.redraw)
    finally:
        addon_utils.enable(PACKAGE)


def test_the_end_of_blender_ends_it_and_tidies_up(index, target):
    index.stalling = "tiny-two"
    code = ("import os, sys, time, tools; from pathlib import Path;"
            "from renderformer_v2.rf2_engine.setup import package_install, wheels;"
            f"wheels.pins = lambda: {wheels.pins()!r};"
            f"package_install.Installation(Path({str(target)!r}), [w for n in {list(NAMES.values())!r} for w in"
            f" wheels.find_wheels(n)], index={index.address!r}); sys.stdin.read(1); os._exit(1)")
    blender = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE)
    assert index.stalled.wait(600) and (target / distributions.STAGING).exists()
    blender.communicate(b"x")
    assert tidied(target)
    index.stalling = ""
    assert finished(installation(index, target)).state == "done"


def test_the_next_start_removes_what_a_killed_process_left(index, target):
    (target / distributions.STAGING / "tmp").mkdir(parents=True)
    addon_utils.disable(PACKAGE)
    addon_utils.enable(PACKAGE)
    assert tidied(target)


def test_the_panels_find_what_has_arrived(index, target):
    assert missing() == list(NAMES)
    begun = package_install.current.begin(target, wanted(), index=index.address)
    assert missing() == list(NAMES)
    finished(begun)
    assert display.redraw() is None and not missing()


def test_a_wheel_that_is_not_the_pinned_one_is_refused(index, target):
    index.wheels["tiny-one", "1.0"] = wheel("tiny-one", payload=10)
    begun = finished(installation(index, target))
    assert begun.state == "failed" and "not the one that this add-on knows" in begun.error
    assert not (target / "tiny_one").exists() and tidied(target)


def test_an_index_that_is_not_there_is_said_in_one_line(index, target, capfd):
    begun = finished(package_install.Installation(target, wanted(), index="http://127.0.0.1:9/simple"))
    assert begun.state == "failed" and "tiny-one 1.0 could not be installed" in begun.error
    assert "connection" in begun.error and "\n" not in begun.error
    assert "packages that are complete are kept" in begun.error  # and nothing of this one: pip resumes no file


def test_a_full_disk_promises_what_is_kept():
    code = ("import errno, sys; sys.path.append(sys.argv[1]); import package_worker as worker, pip_download;"
            "from wheels import Wheel; wheel = Wheel('tiny', '1', (), 1, 1);"
            "print(worker.explain_disk('/x', OSError(errno.ENOSPC, ''), worker.REPEATABLE));"
            "print(pip_download.explain_failure(wheel, 'ERROR: No space left'))")
    done = subprocess.run([sys.executable, "-c", code, SETUP], capture_output=True, text=True, check=True)
    for line in done.stdout.splitlines():
        assert "disk is full (packages that are complete are kept" in line


def test_a_certificate_that_is_not_trusted_is_the_reason_that_is_given():
    log = ("Could not fetch URL https://pypi.org/simple/tiny/: There was a problem confirming the ssl certificate: "
           "HTTPSConnectionPool(host='pypi.org', port=443): Max retries exceeded with url: /simple/tiny/ (Caused by "
           "SSLError(SSLCertVerificationError(1, '[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed: "
           "self-signed certificate in certificate chain (_ssl.c:1006)'))) - skipping\n"
           "ERROR: No matching distribution found for tiny==1\n")
    code = ("import sys; sys.path.append(sys.argv[1]); import pip_download; from wheels import Wheel;"
            "print(pip_download.explain_failure(Wheel('tiny', '1', (), 1, 1), sys.argv[2]))")
    done = subprocess.run([sys.executable, "-c", code, SETUP, log], capture_output=True, text=True, check=True)
    assert "certificate that this computer does not trust" in done.stdout and "PIP_CERT" in done.stdout
    assert "No matching distribution" not in done.stdout


def test_too_little_space_is_known_before(index, target, monkeypatch):
    pins = index.pins()
    for pin in pins["wheels"].values():
        pin["files"]["py3-none-any"]["unpacked"] = 1 << 55
    monkeypatch.setattr(wheels, "pins", lambda: pins)
    with pytest.raises(RuntimeError, match=r"too little space: \S+ GB are needed, \S+ [GM]B are free"):
        bpy.ops.renderformer_v2.install_packages()
    begun = finished(installation(index, target))
    assert begun.state == "failed" and "too little space" in begun.error and not index.requests


def test_a_folder_that_cannot_be_used_is_named(index, target):
    target.write_bytes(b"")
    begun = finished(installation(index, target))
    assert begun.state == "failed" and f"{target} cannot be used: a file is where a folder should be" in begun.error


def test_settings_of_pip_and_python_for_others_are_not_used(index, target, tmp_path, monkeypatch):
    (tmp_path / "broken" / "pip").mkdir(parents=True)
    (tmp_path / "broken" / "pip" / "__init__.py").write_text("raise SystemExit('the wrong pip')")
    (tmp_path / "pip.conf").write_text("[install]\nno-binary = :all:\n")
    for variable, value in {"PIP_INDEX_URL": "http://127.0.0.1:9", "PIP_NO_INDEX": "1", "PIP_TARGET": str(tmp_path),
                            "PIP_CONFIG_FILE": str(tmp_path / "pip.conf"),
                            "PYTHONPATH": str(tmp_path / "broken"), "PIP_REQUIRE_VIRTUALENV": "1"}.items():
        monkeypatch.setenv(variable, value)
    assert finished(installation(index, target)).state == "done"


def test_a_proxy_is_used(index, target, monkeypatch):
    for variable in ("NO_PROXY", "no_proxy"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HTTP_PROXY", index.address.removesuffix("/simple"))
    monkeypatch.setenv("http_proxy", index.address.removesuffix("/simple"))
    begun = finished(package_install.Installation(target, wanted(), index="http://localhost:1/simple"))
    assert begun.state == "done" and all(path.startswith("http://localhost:1/") for path in index.requests)


def test_a_python_without_pip_uses_the_one_that_comes_with_it(index, target, tmp_path, monkeypatch):
    pytest.importorskip("ensurepip")
    venv.create(tmp_path / "bare", with_pip=False, symlinks=os.name != "nt")
    python = tmp_path / "bare" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    assert subprocess.run([python, "-c", "import pip"], capture_output=True).returncode
    monkeypatch.setattr(sys, "executable", str(python))
    begun = finished(installation(index, target))
    assert begun.state == "done", begun.error


def test_a_python_without_any_pip_says_so(tmp_path):
    code = ("import sys; sys.path.append(sys.argv[1]); import pip_download; "
            "pip_download.find_spec = lambda name: None; pip_download.pip_command()")
    done = subprocess.run([sys.executable, "-c", code, SETUP], capture_output=True, text=True)
    assert "Blender's Python has no pip" in done.stderr


def test_pytorch_for_the_cpu_comes_from_its_own_index(target, monkeypatch):
    own, other = Index(tiny_one="1.0"), Index()
    other.wheels["torch", "1.0+cpu"] = wheel("torch", "1.0+cpu")
    pins = own.pins()
    cpu = {"py3-none-any": {"sha256": "", "download": 1, "unpacked": 1}}
    pins["needs"] |= {"torch": ["tiny-one"], wheels.CPU_TORCH: [wheels.CPU_TORCH, "tiny-one"]}
    pins["wheels"][wheels.CPU_TORCH] = {"version": "1.0+cpu", "files": cpu}
    monkeypatch.setattr(wheels, "pins", lambda: pins)
    monkeypatch.setattr(sys, "platform", "linux")
    begun = finished(package_install.Installation(target, wheels.find_wheels("torch", "CPU"), index=own.address,
                                                  torch_index=other.address))
    own.stop()
    other.stop()
    assert begun.state == "done", begun.error
    assert own.downloads() == ["tiny_one"] and other.downloads() == ["torch"]
    assert packages.is_complete("torch")
