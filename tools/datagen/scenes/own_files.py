# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of the user's own files as sources of the generator: panoramas, meshes and sets of texture maps.

The paper's are Poly Haven, Objaverse and MatSynth; any folder will do, with folders in it. Maps belong to one set if
they are in one folder and their names differ in the ending only: basecolor, roughness, metallic, normal, or another
usual word for one of them.
"""
from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

PANORAMAS = ".hdr", ".exr"
MESHES = ".obj", ".ply", ".stl", ".glb", ".gltf", ".fbx", ".usd", ".usda", ".usdc", ".usdz"
PICTURES = ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".exr"
MAPS = {"base": ("basecolor", "albedo", "diffuse", "diff", "color", "col"), "roughness": ("roughness", "rough"),
        "metallic": ("metallic", "metalness", "metal"), "normal": ("normal", "nor", "norgl", "normalgl")}
OTHER_MAPS = ("nordx", "normaldx", "height", "displacement", "disp", "ao", "ambientocclusion", "arm", "opacity",
              "specular", "spec", "bump", "gloss", "preview")


@dataclass
class OwnFiles:
    """The user's files of one process. A seed gives the same scene only with the same files."""

    panoramas: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    textures: tuple[dict[str, Path], ...] = ()  # files by the keys of MAPS, always with "base"
    share: float = 0.5                          # of all choices, the rest is built in
    open_meshes: bool = False                   # whether meshes need not be watertight, as the paper's are
    unusable: set[Path] = field(default_factory=set)

    def use_folders(self, panoramas: Path | None, meshes: Path | None, textures: Path | None, share: float,
                    open_meshes: bool = False) -> None:
        """Raises ValueError naming an option of no use, or a folder that holds nothing of its kind."""
        if not 0 <= share <= 1:
            raise ValueError(f"--own {share:g}: expected a number from 0 to 1")
        self.panoramas = tuple(_list_files(panoramas, "--hdris", PANORAMAS))
        self.meshes = tuple(_list_files(meshes, "--meshes", MESHES))
        self.textures = tuple(group_maps(_list_files(textures, "--textures", PICTURES)))
        self.share, self.open_meshes = share, open_meshes
        if textures and not self.textures:
            names = ", ".join(MAPS["base"])
            raise ValueError(f"--textures {textures} holds no base colours: their names end in {names}")

    def choose(self, rng: np.random.Generator, kind: str) -> Path | dict[str, Path] | None:
        """A file of "panoramas" or "meshes", or a set of "textures"; None for a built-in one.

        Where there are no files of the kind, no random number is drawn.
        """
        files = getattr(self, kind)
        if not files or rng.uniform() >= self.share:
            return None
        return files[int(rng.integers(len(files)))]

    def leave_out(self, path: Path, reason: str) -> None:
        """Say once that a file cannot be used."""
        if path not in self.unusable:
            print(f"{path} is left out: {reason}", flush=True)
        self.unusable.add(path)


OWN_FILES = OwnFiles()  # what the generator of this process chooses from


def _list_files(folder: Path | None, option: str, suffixes: tuple[str, ...]) -> list[Path]:
    """Sorted, so that a seed gives the same scene on every machine."""
    if folder is None:
        return []
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.is_file())
    if not files:
        raise ValueError(f"{option} {folder} holds no files of the kinds {', '.join(suffixes)}")
    return files


def group_maps(files: list[Path]) -> list[dict[str, Path]]:
    """Files that belong together; a name that says nothing is a base colour."""
    sets: dict[tuple, dict[str, Path]] = {}
    for path in files:
        words = [word for word in re.split(r"[\W_]+", path.stem.lower()) if not re.fullmatch(r"\d+k", word)]
        for count in (2, 1, 0):
            ending = "".join(words[len(words) - count:])
            if count == 0 or ending in OTHER_MAPS or any(ending in names for names in MAPS.values()):
                break
        kind = next((kind for kind, names in MAPS.items() if ending in names), None if count else "base")
        if kind:
            sets.setdefault((path.parent, *words[:len(words) - count]), {}).setdefault(kind, path)
    return [maps for maps in sets.values() if "base" in maps]
