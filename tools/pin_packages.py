# SPDX-License-Identifier: GPL-3.0-or-later
"""Write rf2_engine/setup/wheels.json: what the Install Packages button may install, with hashes and sizes.

    python -m tools.pin_packages

The versions are those of the Python that runs this, which are the ones that were tried; names, hashes and sizes of
their wheels for all systems come from pip's default package index.
"""
from __future__ import annotations

import json
import re
from collections import defaultdict
from importlib import metadata
from itertools import product
from urllib.request import Request, urlopen

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name, parse_wheel_filename

from .extension import ROOT

OUTPUT = ROOT / "rf2_engine" / "setup" / "wheels.json"
INDEX = "https://pypi.org/simple"
ROOTS = ("torch", "safetensors", "fast-simplification", "embreex", "huggingface-hub", "pyyaml", "diffusers", "pillow")
LEFT_OUT = {
    "numpy",       # is always Blender's
    "setuptools",  # compiles extensions of PyTorch, of which there are none
    "hf-xet",      # a protocol that hub_worker.py switches off
}
PYTHONS = ("3.11", "3.13", "3.14")
SYSTEMS = {  # ending of a wheel's platform -> what markers ask for
    "x86_64 linux": ("Linux", "linux", "x86_64"), "aarch64 linux": ("Linux", "linux", "aarch64"),
    "arm64 macosx": ("Darwin", "darwin", "arm64"), "x86_64 macosx": ("Darwin", "darwin", "x86_64"),
    "amd64 win": ("Windows", "win32", "AMD64"), "arm64 win": ("Windows", "win32", "ARM64"),
}
UNPACKED = 3.0  # times the wheel, where nothing is installed here to measure
CUDA = ("nvidia-", "cuda-", "triton")
CPU_WHEELS = {  # PyTorch's own index, not the one above: sizes are estimates, and the index has the only hashes
    f"cp{python}-cp{python}-manylinux_2_28_{machine}": {"sha256": "", "download": download, "unpacked": unpacked}
    for python in ("311", "313", "314")
    for machine, download, unpacked in (("x86_64", 190_000_000, 760_000_000), ("aarch64", 150_000_000, 600_000_000))}
CUDA_WHEELS = {  # likewise, for Windows, where it holds all of CUDA
    f"cp{python}-cp{python}-win_amd64": {"sha256": "", "download": 2_700_000_000, "unpacked": 4_700_000_000}
    for python in ("311", "313", "314")}


def find_needs(root: str) -> dict[str, set[str]]:
    """{distribution: SYSTEMS where it is needed} of everything that `root` needs, itself too."""
    systems_by_name = defaultdict(set)
    for (system, (platform_system, sys_platform, machine)), python in product(SYSTEMS.items(), PYTHONS):
        environment = {"platform_system": platform_system, "sys_platform": sys_platform, "platform_machine": machine,
                       "python_version": python, "python_full_version": f"{python}.0",
                       "os_name": "nt" if sys_platform == "win32" else "posix"}
        waiting = [Requirement(root)]
        visited = set()
        while waiting:
            requirement = waiting.pop()
            name = canonicalize_name(requirement.name)
            key = name, frozenset(requirement.extras)
            if name in LEFT_OUT or key in visited:
                continue
            visited.add(key)
            systems_by_name[name].add(system)
            for extra in (requirement.extras or {""}):
                waiting += [further for further in map(Requirement, read_requirements(name))
                            if not further.marker or further.marker.evaluate(environment | {"extra": extra})]
    return systems_by_name


def read_requirements(name: str) -> list[str]:
    try:
        return metadata.requires(name) or []
    except metadata.PackageNotFoundError:
        return []  # needed on other systems only


def list_wheels(name: str) -> list[dict]:
    request = Request(f"{INDEX}/{name}/", headers={"Accept": "application/vnd.pypi.simple.v1+json"})
    with urlopen(request, timeout=60) as answer:
        return [file for file in json.load(answer)["files"] if file["filename"].endswith(".whl")]


def choose_version(name: str, offered: list[dict]) -> str:
    """The installed one, else the newest."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return str(max(parse_wheel_filename(file["filename"])[1] for file in offered))


def find_system(platform: str) -> str:
    """The system of a wheel, as in SYSTEMS, or "any"; "" for one that Blender does not run on."""
    if platform == "any" or platform.startswith("macosx") and platform.endswith("universal2"):
        return "any"
    return next((system for system in SYSTEMS for machine, kind in [system.split()]
                 if platform.endswith(machine) and platform.startswith(("many" + kind, kind))), "")


def fits(python: str, abi: str) -> bool:
    """Whether one of PYTHONS can use a wheel with this tag."""
    if abi == "none":
        return "py3" in python.split(".")
    return abi == "abi3" or python == abi and python in [f"cp{known.replace('.', '')}" for known in PYTHONS]


def pin(name: str, systems: set[str]) -> dict:
    """{"version", "files": {tag: {"sha256", "download", "unpacked" (bytes)}}}."""
    offered = list_wheels(name)
    version = choose_version(name, offered)
    pinned = {}
    for file in offered:
        offered_version = parse_wheel_filename(file["filename"])[1]
        python, abi, platform = file["filename"].removesuffix(".whl").split("-")[-3:]
        system = find_system(platform)
        if str(offered_version) == version and fits(python, abi) and system and (system == "any" or system in systems):
            pinned[f"{python}-{abi}-{platform}"] = {"sha256": file["hashes"]["sha256"], "download": file["size"]}
    size = measure_unpacked(name)
    here = max((file["download"] for tag, file in pinned.items() if tag.endswith(("x86_64", "any"))
                and "macosx" not in tag), default=0)
    for file in pinned.values():
        file["unpacked"] = round(file["download"] * (size / here if size and here else UNPACKED))
    return {"version": version, "files": pinned}


def measure_unpacked(name: str) -> int:
    """Bytes of what is installed here, 0 if it is not."""
    try:
        return sum(file.size or 0 for file in metadata.files(name) or ())
    except metadata.PackageNotFoundError:
        return 0


def main() -> None:
    graph = {root: find_needs(root) for root in ROOTS}
    systems = defaultdict(set)
    for needs in graph.values():
        for name, where in needs.items():
            systems[name] |= where
    wheels = {name: pin(name, where) for name, where in sorted(systems.items())}
    wheels["torch+cpu"] = {"version": f"{wheels['torch']['version']}+cpu", "files": CPU_WHEELS}
    groups = {root: sorted(needs) for root, needs in graph.items()}
    wheels["torch+cuda"] = {"version": wheels["torch"]["version"], "files": CUDA_WHEELS}
    for own in ("torch+cpu", "torch+cuda"):
        groups[own] = [own, *(name for name in groups["torch"] if name != "torch" and not name.startswith(CUDA))]
    text = json.dumps({"needs": groups, "wheels": wheels}, indent=1)
    OUTPUT.write_text(re.sub(r'\n {5,}|\n {4}(?=})', " ", text) + "\n")  # a line for each wheel
    print(f"{OUTPUT}: {len(wheels)} packages, {sum(len(wheel['files']) for wheel in wheels.values())} wheels")


if __name__ == "__main__":
    main()
