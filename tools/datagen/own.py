# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of the user's own files as sources of the generator: panoramas, meshes and sets of texture maps.

The paper's are Poly Haven, Objaverse and MatSynth; any folder will do, with folders in it. What belongs together in a
set of maps is told by the names: all files of a folder, or of a name, that end in basecolor, roughness, metallic and
normal, or in what else these are called.
"""
from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PANORAMAS = ".hdr", ".exr"
MESHES = ".obj", ".ply", ".stl", ".glb", ".gltf", ".fbx", ".usd", ".usda", ".usdc", ".usdz"
PICTURES = ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".exr"
MAPS = {"base": ("basecolor", "albedo", "diffuse", "diff", "color", "col"), "roughness": ("roughness", "rough"),
        "metallic": ("metallic", "metalness", "metal"), "normal": ("normal", "nor", "norgl", "normalgl")}
OTHER_MAPS = ("nordx", "normaldx", "height", "displacement", "disp", "ao", "ambientocclusion", "arm", "opacity",
              "specular", "spec", "bump", "gloss", "preview")


@dataclass(frozen=True)
class Sources:
    panoramas: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    textures: tuple[dict[str, Path], ...] = ()  # files by the keys of MAPS, always with "base"
    share: float = 0.5                          # of what is chosen, the rest is built in

    def chosen(self, rng: np.random.Generator, kind: str):
        """One of a kind, or None for a built-in one; without own ones no random number is taken."""
        files = getattr(self, kind)
        if not files or rng.uniform() >= self.share:
            return None
        return files[int(rng.integers(len(files)))]


current = Sources()  # of this process


def use(panoramas: Path | None, meshes: Path | None, textures: Path | None, share: float) -> None:
    """Raises ValueError naming an option of no use, or a folder that holds nothing of its kind."""
    global current
    if not 0 <= share <= 1:
        raise ValueError(f"--own {share:g}: expected a number from 0 to 1")
    current = Sources(tuple(_files(panoramas, "--hdris", PANORAMAS)), tuple(_files(meshes, "--meshes", MESHES)),
                      tuple(texture_sets(_files(textures, "--textures", PICTURES))), share)
    if textures and not current.textures:
        raise ValueError(f"--textures {textures} holds no base colours: their names end in {', '.join(MAPS['base'])}")


def _files(folder: Path | None, option: str, suffixes: tuple[str, ...]) -> list[Path]:
    """Sorted, so that a seed gives the same scene on every machine."""
    if folder is None:
        return []
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.is_file())
    if not found:
        raise ValueError(f"{option} {folder} holds no files of the kinds {', '.join(suffixes)}")
    return found


def texture_sets(files: list[Path]) -> list[dict[str, Path]]:
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
