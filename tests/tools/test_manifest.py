# SPDX-License-Identifier: GPL-3.0-or-later
"""Manifests of samples: folders of many machines become one by copying, and what is broken is named."""
import json
import shutil

import pytest

from tests.tools.test_train_ranks import write
from tools.datagen import manifest
from tools.datagen.sample_files import read_facts


def machine(folder, seeds) -> None:
    """What a process of tools.datagen leaves."""
    for seed in seeds:
        write(folder, seed)
        path = folder / f"scene_{seed:08d}.npz"
        manifest.append_entries(folder / f"manifest_{seeds[0]:08d}.jsonl", [manifest.make_entry(path)])


@pytest.fixture
def merged(tmp_path):
    for name, seeds in (("a", (1, 2)), ("b", (3, 4))):
        machine(tmp_path / name, seeds)
        shutil.copytree(tmp_path / name, tmp_path / "all", dirs_exist_ok=True)
    return tmp_path / "all"


def run(folder, monkeypatch, capsys) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["manifest", str(folder)])
    return manifest.main(), *capsys.readouterr()


def test_folders_of_two_machines_are_merged_by_copying(merged, monkeypatch, capsys):
    status, said, wrong = run(merged, monkeypatch, capsys)
    assert status == 0 and not wrong and said.startswith("4 samples, 4 views, ")
    assert "1 with environment, 1 with volumes" in said
    assert {name: manifest.facts_from_entry(entry) for name, entry in manifest.read_entries(merged).items()} == {
        path.name: read_facts(path) for path in merged.glob("scene_*.npz")}


def test_what_is_missing_changed_or_damaged_is_named(merged, monkeypatch, capsys):
    paths = [merged / f"scene_{seed:08d}.npz" for seed in range(1, 6)]
    paths[0].unlink()
    content = bytearray(paths[1].read_bytes())
    content[len(content) // 2] ^= 1
    paths[1].write_bytes(content)
    paths[2].write_bytes(paths[2].read_bytes()[:1000])
    paths[4].write_bytes(b"no sample")
    (merged / "manifest_00000001.jsonl").open("a").write('{"file": "scene_000')
    status, said, wrong = run(merged, monkeypatch, capsys)
    assert status == 1 and said.startswith("1 samples")
    assert [line.partition(": ")[2].partition(" (")[0] for line in wrong.splitlines()[:4]] == [
        "is missing", "has another content than when it was made",
        f"has 1000 bytes instead of {manifest.read_entries(merged)[paths[2].name]['bytes']}", "cannot be read"]
    assert "4 to be made again" in wrong


def test_a_sample_without_a_line_gets_one_and_the_newest_line_counts(merged, monkeypatch, capsys):
    write(merged, 5)
    assert run(merged, monkeypatch, capsys)[0] == 0
    assert json.loads((merged / manifest.ADDED).read_text())["file"] == "scene_00000005.npz"
    write(merged, 2)
    changed = merged / "scene_00000002.npz"
    write(merged.parent / "other", 4)
    shutil.copy(merged.parent / "other" / "scene_00000004.npz", changed)
    assert run(merged, monkeypatch, capsys)[0] == 1
    manifest.append_entries(merged / "manifest_00000001.jsonl", [manifest.make_entry(changed)])
    assert run(merged, monkeypatch, capsys)[0] == 0


def test_a_mistyped_folder_is_said(tmp_path, monkeypatch, capsys):
    assert run(tmp_path / "none", monkeypatch, capsys)[0] == 2
