# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders import one another in one direction only."""
import ast
import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.sources import ROOT

# Rooms whose inner folders count as one. Delete a name to check the folders in it as well.
AS_ONE = {"rf2_engine": set(), "model": {"light"}}
# weights/ finds out which network the files of a folder hold, and builds it.
BUILDERS = {("model/weights", "model/guided"), ("model/weights", "model/published")}
# Floors of the conversion, from the ground: folders import from lower floors alone.
CONVERT = (["data"], ["shading/noise"], ["shading"], ["camera", "meshes", "lamps", "media"], ["fitting", "copying"])

Edges = dict[tuple[str, str], list[str]]


def imported_files(path: Path) -> set[Path]:
    """Files of the repository that a file imports relatively, inside functions too."""
    files = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for candidate in [folder] + [folder / alias.name for alias in node.names]:
                files |= {file for file in (candidate.with_suffix(".py"), candidate / "__init__.py") if file.is_file()}
    return files


def room(path: Path, package: str) -> str:
    """The folder that a file belongs to; a module directly in the package is a room of its own."""
    *folders, name = path.relative_to(ROOT / package).parts
    if not folders:
        return f"{package}/{name}"
    if folders[0] in AS_ONE[package]:
        del folders[1:]
    return "/".join([package, *folders])


def room_edges(package: str) -> Edges:
    """{(room, room that it imports): ["file imports file", ...]}."""
    root, edges = ROOT / package, defaultdict(list)
    for path in sorted(root.rglob("*.py")):
        for target in imported_files(path):
            if root in target.parents and target != root / "__init__.py" and (
                    rooms := (room(path, package), room(target, package)))[0] != rooms[1]:
                edges[rooms].append(f"{path.relative_to(ROOT)} imports {target.relative_to(ROOT)}")
    return edges


def circle(edges: Edges) -> list[str]:
    """The imports that make up a circle of rooms; [] if there is none."""
    graph = defaultdict(set)
    for importer, target in edges:
        graph[importer].add(target)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        rooms = error.args[1]
        return [line for target, importer in zip(rooms, rooms[1:], strict=False) for line in edges[importer, target]]
    return []


def test_a_circle_is_found():
    assert circle({("a", "b"): ["a/x imports b/y"], ("b", "c"): ["b/y imports c/z"]}) == []
    found = circle({("a", "b"): ["a/x imports b/y"], ("b", "c"): ["b/y imports c/z"], ("c", "a"): ["c/w imports a/x"]})
    assert sorted(found) == ["a/x imports b/y", "b/y imports c/z", "c/w imports a/x"]


@pytest.mark.parametrize("package", ["rf2_engine", "model"])
def test_folders_import_one_another_in_one_direction(package):
    edges = {rooms: lines for rooms, lines in room_edges(package).items() if rooms not in BUILDERS}
    assert edges
    assert circle(edges) == []


def test_the_root_of_model_knows_the_guided_network_by_its_renderer_alone():
    importers = {importer for importer, target in room_edges("model") if target == "model/guided"}
    assert {name for name in importers if name.endswith(".py")} <= {"model/renderer.py"}


def test_light_knows_no_network():
    edges = room_edges("model")
    assert ("model/guided", "model/light") in edges
    assert [line for rooms, lines in edges.items() if rooms[0].startswith("model/light") and
            rooms[1] in ("model/network", "model/guided") for line in lines] == []


def test_the_conversion_is_built_in_floors():
    floors = {f"rf2_engine/convert/{name}": i for i, names in enumerate(CONVERT) for name in names}
    floors["rf2_engine/convert"] = len(CONVERT)
    assert {room(path, "rf2_engine") for path in (ROOT / "rf2_engine/convert").rglob("*.py")} == set(floors)
    assert [lines for (importer, target), lines in room_edges("rf2_engine").items()
            if importer in floors and target in floors and floors[target] >= floors[importer]] == []


def test_only_what_reads_blender_imports_it():
    folders = [ROOT / "rf2_engine/convert" / name for names in CONVERT for name in names]
    files = [path for folder in folders if folder.name not in ("camera", "copying") for path in folder.glob("*.py")]
    assert len(files) > 40
    assert [path.name for path in files if re.search("^(import|from) (bpy|mathutils)", path.read_text(), re.M)] == []
