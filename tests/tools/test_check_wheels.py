# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels of other systems: chosen by their tags, installed into a folder up to the import, and looked into."""
import importlib.util
import struct
import sys
from pathlib import Path

import pytest

from tests.rf2_engine.setup.index import wheel
from tools import check_wheels
from tools.common import wheel_files
from tools.common.binaries import Binary, read_binary

import distributions  # isort: skip  # check_wheels makes it importable
PLATFORMS, PYTHONS = list(wheel_files.PLATFORMS), wheel_files.PYTHONS


def mach(machine: int, *needs: str) -> bytes:
    """A Mach-O file of nothing but its load commands."""
    commands = b"".join(
        struct.pack("<6I", 0xC, 24 + len(name), 24, 0, 0, 0) + name for name in
        (need.encode() + b"\0" * (8 - len(need) % 8) for need in needs))
    return struct.pack("<8I", 0xFEEDFACF, machine, 0, 6, len(needs), len(commands), 0, 0) + commands


def test_headers_say_what_a_file_is_made_for_and_what_it_loads():
    pip = Path(importlib.util.find_spec("pip").origin).parent / "_vendor" / "distlib"  # programs for Windows
    assert read_binary((pip / "t64.exe").read_bytes()) == Binary("win", ("amd64",), ("KERNEL32.dll", "SHLWAPI.dll"))
    assert read_binary((pip / "t64-arm.exe").read_bytes()).machines == ("arm64",)
    arm, intel = 0x0100000C, 0x01000007
    one = mach(arm, "@rpath/libc10.dylib", "/usr/lib/libSystem.B.dylib")
    assert read_binary(one) == Binary("macosx", ("arm64",), ("@rpath/libc10.dylib", "/usr/lib/libSystem.B.dylib"))
    other = mach(intel, "@rpath/libc10.dylib")
    both = struct.pack(">2I", 0xCAFEBABE, 2) + struct.pack(">5I", intel, 3, 48, len(other), 3) + struct.pack(
        ">5I", arm, 0, 48 + len(other), len(one), 3) + other + one
    assert read_binary(both).machines == ("x86_64", "arm64") and read_binary(b"text") is None
    with pytest.raises((struct.error, ValueError)):
        read_binary(one[:60])


@pytest.mark.skipif(sys.platform != "linux", reason="a library of this system")
def test_libraries_of_this_system():
    import torch
    folder = Path(torch.__file__).parent
    found = read_binary(next(folder.glob("_C.*.so")).read_bytes())
    assert found.system == "linux" and "libtorch_python.so" in found.needs and "libc.so.6" in found.needs


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("python", PYTHONS)
def test_every_system_has_one_wheel_of_what_it_needs(platform, python):
    found = wheel_files.find_fitting(platform, python)
    names = {name for name, *_ in found}
    assert len(names) == len(found) and set(wheel_files.SMALL) <= names and "numpy" not in names
    assert ("torch" in names) == (platform != "macos-x64"), "PyTorch is made for all but this one"
    assert all(len(pin["sha256"]) == 64 for *_, pin in found)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_wheels_of_a_foreign_system_are_installed_up_to_the_import(platform, tmp_path):
    target, expected = tmp_path / "packages", {}
    for name, version, tag, _ in wheel_files.find_fitting(platform, "cp311"):
        if name in wheel_files.SMALL:
            file = tmp_path / wheel_files.file_name(name, version, tag)
            file.write_bytes(wheel(name, version, payload=10))
            check_wheels.install(file, name, version, target)
            expected[name] = version
    found = check_wheels.check(platform, "cp311", target, expected)
    assert found["distributions"] == 3 and not found["problems"] and found["files"] > 9
    (target / "embreex" / "data.bin").write_text("x")
    (problem,) = check_wheels.check(platform, "cp311", target, expected)["problems"]
    assert problem.startswith("embreex") and problem.endswith("is not complete")
    assert not (target / distributions.STAGING).exists()


def test_what_is_missing_or_made_for_another_system_is_named():
    files = {"a/_native.pyd": Binary("win", ("amd64",), ("KERNEL32.dll", "one.dll", "python311.dll")),
             "a/lib/one.dll": Binary("win", ("amd64",), ("lost.dll", "VCRUNTIME140.dll")),
             "a/lib/unused.dll": Binary("win", ("amd64",), ("also_lost.dll",)),
             "a/old.pyd": Binary("win", ("arm64",), ())}
    assert check_wheels.find_missing_libraries(files, "win") == ["a/lib/one.dll needs lost.dll"]
    assert check_wheels.find_wrong_machines(files, "win", "amd64") == ["a/old.pyd is made for win arm64"]
    apple = {"b/_native.so": Binary("macosx", ("arm64",), ("/usr/lib/libSystem.B.dylib", "@rpath/libomp.dylib"))}
    assert check_wheels.find_missing_libraries(apple, "macosx") == ["b/_native.so needs @rpath/libomp.dylib"]


def test_paths_that_are_too_long_for_windows_are_found():
    room = check_wheels.LONGEST - len(check_wheels.WINDOWS)
    assert 100 < room < 200 and check_wheels.find_too_long(["x" * room, "y" * (room + 1)]) == ["y" * (room + 1)]
