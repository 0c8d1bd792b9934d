# SPDX-License-Identifier: GPL-3.0-or-later
"""A package for each platform, with the wheels that fit it; no network is needed for these tests."""
import hashlib
import tomllib
import zipfile

import pytest

from tests.rf2_engine.setup.index import wheel
from tools import build
from tools.common import wheel_files

PLATFORMS = list(wheel_files.PLATFORMS)


@pytest.fixture
def wheels(tmp_path):
    """Files with the names of a platform's wheels, and little in them."""
    def make(platform: str) -> list:
        files = [tmp_path / wheel_files.file_name(name, version, tag)
                 for name, version, tag, _ in wheel_files.find_small(platform)]
        for path in files:
            path.write_bytes(wheel(path.name.split("-")[0].replace("_", "-"), payload=10))
        return files
    return make


@pytest.mark.parametrize("platform", PLATFORMS)
def test_every_python_has_each_small_package_once(platform):
    found = wheel_files.find_small(platform)
    for python in wheel_files.PYTHONS:
        fit = [name for name, _, tag, _ in found if tag.startswith(python) or "abi3" in tag]
        assert sorted(fit) == sorted(wheel_files.SMALL)
    assert all(len(pin["sha256"]) == 64 for *_, pin in found) and "numpy" not in {name for name, *_ in found}


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_package_is_valid_and_says_what_it_brings(platform, wheels, tmp_path):
    files = wheels(platform)
    archive = build.build_for(platform, files, tmp_path / "built")
    with zipfile.ZipFile(archive) as package:
        manifest, names = tomllib.loads(package.read(build.MANIFEST).decode()), package.namelist()
    assert manifest["platforms"] == [platform] and archive.name.endswith(f"{platform.replace('-', '_')}.zip")
    assert {name.removeprefix("./") for name in manifest["wheels"]} == {n for n in names if n.endswith(".whl")}
    assert len(manifest["wheels"]) == len(files) == 5
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later", *wheel_files.LICENSES] and manifest["permissions"]
    assert "model/weights/rf2_small/model.safetensors" in names and not any(n.startswith("tests/") for n in names)


def test_wheels_that_are_there_are_not_downloaded_again(tmp_path, monkeypatch):
    content, asked = wheel("safetensors"), []
    tag, pin = "cp310-abi3-win_amd64", {"sha256": hashlib.sha256(content).hexdigest()}
    monkeypatch.setattr(wheel_files, "find_small", lambda platform: [("safetensors", "1", tag, pin)])
    monkeypatch.setattr(wheel_files, "_download", lambda requirement, tag, folder, python: asked.append(requirement))
    (tmp_path / "safetensors-1-cp310-abi3-win_amd64.whl").write_bytes(content)
    assert len(wheel_files.fetch("windows-x64", tmp_path)) == 1 and not asked
    (tmp_path / "safetensors-1-cp310-abi3-win_amd64.whl").write_bytes(content[:-1])
    wheel_files.fetch("windows-x64", tmp_path)
    assert asked == [f"safetensors==1 --hash=sha256:{pin['sha256']}"]
