# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of training data: one .npz per scene, written whole or not at all, read without bpy.

Files are smaller than what is in memory: tiles are averaged to STORED_TILE^2 texels (what the small preset pools them
to) unless the caller wants more, and equal ones are stored once; guides but for positions, environment and reference
passes are half floats. What mirrors and glass show is found again by `load_with_paths`.
"""
from __future__ import annotations

import io
import os
import zipfile
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from renderformer_v2.model.first_hits.sheets import through_sheets
from renderformer_v2.model.light.specular.ends import add_path_ends
from renderformer_v2.model.pictures import to_half
from renderformer_v2.model.scene import TILE_SIZE, Geometry, Guides, RenderScene, View, Volumes

STORED_TILE = 8
HINT_SAMPLES = 8  # of first hits and traced light, as F12 has in large pictures
GLASS = 0.01      # of a pixel's colour
SHARES = "glossy_kept", "matte_share"  # guides that are 1 where they are not there
EVEN = 1 / 256    # by how much the parameters of a homogeneous tile may differ


@dataclass(frozen=True)
class SampleCounts:
    """Samples per pixel that Cycles takes for the pictures of a training sample."""

    reference: int
    equal: int = 0  # of a picture as it would be set beside ours, in the pass "equal"; 0 for none
    hints: int = HINT_SAMPLES
    most_hints: int = HINT_SAMPLES

    def of_seed(self, seed: int) -> SampleCounts:
        """The counts of one scene, with between `hints` and `most_hints` samples of traced light."""
        ratio = max(self.most_hints / self.hints, 1) ** np.random.default_rng(seed).random()
        return replace(self, hints=round(self.hints * ratio))


@dataclass(frozen=True)
class Facts:
    """What a sample holds, as far as a curriculum asks."""

    triangles: int
    width: int
    height: int
    views: int
    textures: bool      # parameters that vary within a triangle
    environment: bool   # light from the world
    volumes: bool
    transmission: bool  # glass that a view sees


class StoredSample(NamedTuple):
    """A scene, and for each of its views, which are of equal size: the camera, first hits, and Cycles' pictures.

    `passes` has the keys of rf2_engine/cycles/session.py: "combined" (H, W, 4), denoised, premultiplied, with directly
    seen emitters but without the directly seen world, both of which are passes of their own ("emission",
    "environment"), and noisy light per lobe, for which combined = diffuse_color * (diffuse_direct + diffuse_indirect)
    + glossy and transmission likewise + volume_direct + volume_indirect + emission. Guides have the few samples of
    F12; in older files they have the reference's, and those are its emission and environment.
    """

    scene: RenderScene
    views: list[View]
    guides: list[Guides]
    passes: list[dict[str, np.ndarray]]  # {name: (H, W, C) f32}


def save_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a compressed .npz under a temporary name and rename it, so that a killed run leaves no half file."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    # zlib's fastest level: numpy's own takes four times as long for 5 % less.
    try:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, array in arrays.items():
                data = io.BytesIO()
                np.lib.format.write_array(data, np.ascontiguousarray(array), allow_pickle=False)
                archive.writestr(f"{name}.npy", data.getvalue())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def sample_path(folder: Path, seed: int) -> Path:
    return folder / f"scene_{seed:08d}.npz"


def sample_paths(folder: Path) -> list[Path]:
    """Finished samples of a folder, by seed."""
    return sorted(Path(folder).glob("scene_*.npz"))


def save_sample(path: Path, scene: RenderScene, views: list[View], guides: list[Guides],
                passes: list[dict[str, np.ndarray]], tile_size: int = STORED_TILE, hints: int = HINT_SAMPLES) -> None:
    """Store a scene and, per view of equal size, its camera, guides and reference passes {name: (H, W, C)}.

    tile_size: texels of a tile's side, a divisor of TILE_SIZE. hints: samples that the guides are made of.
    """
    arrays = {f"scene.{f.name}": getattr(scene, f.name) for f in fields(RenderScene)
              if isinstance(getattr(scene, f.name), np.ndarray)}
    arrays |= _pack_tiles(scene, tile_size)
    arrays["scene.normals"] = scene.normals.astype(np.float16)
    if scene.geometry is not None:
        arrays |= {f"geometry.{f.name}": getattr(scene.geometry, f.name) for f in fields(Geometry)}
        arrays["geometry.normals"] = arrays["geometry.normals"].astype(np.float16)
    if scene.environment is not None:
        arrays["scene.environment"] = to_half(scene.environment)
    if scene.volumes is not None:
        arrays |= {f"volumes.{f.name}": getattr(scene.volumes, f.name) for f in fields(Volumes)}
    for f in fields(View):
        if f.name == "panorama":  # the network has no such rays, and so no samples
            continue
        arrays[f"view.{f.name}"] = np.stack([np.asarray(getattr(v, f.name)) for v in views])
    for name in dict.fromkeys(name for g in guides for name in g.arrays()):
        # A pass that only some views have is black in the others, and a share is all.
        missing = np.full_like(next(g.arrays()[name] for g in guides if name in g.arrays()), name in SHARES)
        arrays[f"guides.{name}"] = np.stack([_pack_guide(name, g.arrays().get(name, missing)) for g in guides])
    arrays["hint_samples"] = np.int32(hints)
    for name in passes[0]:
        arrays[f"passes.{name}"] = np.stack([to_half(p[name]) for p in passes])
    save_arrays(path, arrays)


def load_sample(path: Path, tile_size: int = TILE_SIZE) -> StoredSample:
    """The sample of a file, floats as f32.

    With `tile_size` STORED_TILE the tiles are not blown up to the contract's 32 x 32, which saves the training loop a
    copy of up to 70 MB.
    """
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}

    def group(prefix: str) -> dict[str, np.ndarray]:
        return {key.partition(".")[2]: array for key, array in arrays.items() if key.startswith(prefix + ".")}

    view, guide, passes = group("view"), group("guides"), group("passes")
    count = len(view["width"])
    views = [View(view["camera_to_world"][i], view["focal"][i], view["principal"][i], int(view["width"][i]),
                  int(view["height"][i])) for i in range(count)]
    guides = [Guides(**{k: _unpack_guide(k, v[i]) for k, v in guide.items()}) for i in range(count)]
    hints = arrays["hint_samples"].item() if "hint_samples" in arrays else HINT_SAMPLES
    guides = [replace(g, samples=np.full_like(g.alpha, hints)) for g in guides]
    passes = [{k: v[i].astype(np.float32) for k, v in passes.items()} for i in range(count)]
    for g, p in zip(guides, passes, strict=True):
        for name in ("emission", "environment"):
            p.setdefault(name, getattr(g, name))
    scene = _unpack_scene(group("scene"), group("volumes"), group("geometry"), tile_size)
    return StoredSample(scene, views, guides, passes)


def load_with_paths(path: Path) -> StoredSample:
    """`load_sample`, and in the guides the ends of specular paths, as the engine finds them today."""
    sample = load_sample(path)
    return sample._replace(guides=[add_path_ends(through_sheets(guides, sample.scene, view), sample.scene, view)
                                   for view, guides in zip(sample.views, sample.guides, strict=True)])


def read_facts(path: Path) -> Facts:
    """The Facts of a file, without building its scene. A damaged file raises whatever the damage leads to."""
    with np.load(path) as file:
        tiles, names = file["scene.tiles"], set(file.files)
        return Facts(
            triangles=len(file["scene.tile_index"]), width=int(file["view.width"][0]),
            height=int(file["view.height"][0]), views=len(file["view.width"]),
            textures=bool((np.ptp(tiles, axis=(2, 3)) > EVEN).any()),
            environment="scene.environment" in names and bool((file["scene.environment"] > 0).any()),
            volumes="volumes.density" in names, transmission=bool((file["guides.transmission_color"] > GLASS).any()))


def _pack_tiles(scene: RenderScene, size: int) -> dict[str, np.ndarray]:
    t, c = scene.tiles.shape[:2]
    step = TILE_SIZE // size
    small = scene.tiles.reshape(t, c, size, step, size, step).astype(np.float32).mean(axis=(3, 5))
    small = small.astype(np.float16)
    rows = [small.reshape(t, -1).view(np.uint16), scene.tile_latents.view(np.uint16)]
    lobes = scene.two_lobes
    if lobes is not None:
        lobes = lobes.reshape(t, -1, size, step, size, step).astype(np.float32).mean(axis=(3, 5)).astype(np.float16)
        rows.append(lobes.reshape(t, -1).view(np.uint16))
    _, first, inverse = np.unique(np.concatenate(rows, axis=1), axis=0, return_index=True, return_inverse=True)
    packed = {"scene.tiles": small[first], "scene.tile_index": inverse.ravel()[scene.tile_index].astype(np.int32)}
    packed |= {} if scene.latents is None else {"scene.latents": scene.latents[first]}
    return packed if lobes is None else packed | {"scene.two_lobes": lobes[first]}


def _unpack_scene(scene: dict[str, np.ndarray], volumes: dict[str, np.ndarray], geometry: dict[str, np.ndarray],
                  tile_size: int) -> RenderScene:
    repeat = max(1, tile_size // scene["tiles"].shape[-1])
    for name in ("tiles", "two_lobes"):
        if name in scene:
            scene[name] = scene[name].repeat(repeat, axis=2).repeat(repeat, axis=3)
    for group in (scene, geometry):
        if "normals" in group:
            group["normals"] = _normalize(group["normals"].astype(np.float32))
    if "environment" in scene:
        scene["environment"] = scene["environment"].astype(np.float32)
    return RenderScene(**scene, volumes=Volumes(**volumes) if volumes else None,
                       geometry=Geometry(**geometry) if geometry else None)


def _pack_guide(name: str, array: np.ndarray) -> np.ndarray:
    if name in ("hit_triangle", "position"):  # rays start there
        return array
    if name == "hit_barycentric":
        return (array * 255 + 0.5).astype(np.uint8)
    return to_half(array)


def _unpack_guide(name: str, array: np.ndarray) -> np.ndarray:
    if name == "hit_triangle":
        return array
    return array.astype(np.float32) / (255 if name == "hit_barycentric" else 1)


def _normalize(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True).clip(1e-6)
