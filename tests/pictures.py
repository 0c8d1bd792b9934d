# SPDX-License-Identifier: GPL-3.0-or-later
"""What the model makes of four scenes, from first hits by our own rays, and what was recorded of it.

Not the pictures of F12: Cycles' passes differ in their last bits from run to run, even on one thread. What is ours is
the same again, the converted scene and the model's picture of it, but only on one kind of processor: another one
rounds differently, and where a random ray just misses something there, a pixel can change by percents, or a room that
is lit through a gap.
"""
from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import torch

from examples import bounced, effects, room
from renderformer_v2.model.compute import threads
from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.light.specular.ends import add_path_ends
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from renderformer_v2.rf2_engine.convert.data.report import Report
from renderformer_v2.rf2_engine.convert.scene import convert

FOLDER = Path(__file__).parent / "fixtures"
HASHES, COPIES = FOLDER / "pictures.json", FOLDER / "pictures.npz"
SCENES = {"room": room.build, "door_ajar": bounced.door_ajar, "glass_torus": bounced.glass_torus,
          "mirror": effects.mirror}
SIZE = 64       # pixels
BUDGET, LONGEST_EDGE = 4096, 0.2  # the defaults
TRACED = 0.8    # of the diffuse colour, in place of light that Cycles traces
STEP = 2        # of the rows and columns of a picture that its copy has
LIGHT = "network alone", "with traced light"


WITHIN = 0.1    # of a pixel and the mean one, by which it may be off its copy on processors of another kind
PIXELS = 0.985  # share of the pixels that have to be
MEAN = 0.03     # of the mean pixel, by which pixels may be off on average


@dataclass
class Computed:
    """Of a scene: hashes by what they are of, and pictures (SIZE, SIZE, 3) f32 by their light."""

    hashes: dict[str, str]
    pictures: dict[str, np.ndarray]


def compute(name: str) -> Computed:
    """One of SCENES, converted and lit on one thread."""
    SCENES[name]()
    for mesh in bpy.data.meshes:
        put_in_order(mesh)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    view = convert_camera(depsgraph, SIZE, SIZE, None)
    with threads.limited(1), threads.team(1):
        scene = convert(depsgraph, view, ConversionOptions(BUDGET, LONGEST_EDGE), Report())
        guides = add_path_ends(cast_guides(scene, view), scene, view)
        traced = replace(guides, traced=np.float32(TRACED) * guides.diffuse_color)
        encoded = Renderer(device="cpu", precision="fp32").encode(scene, SIZE)
        lobes = dict(zip(LIGHT, (encoded.lobes(view, hits) for hits in (guides, traced)), strict=True))
    hashes = {"scene": sha256(scene), "first hits": sha256(guides)}
    return Computed(hashes | {light: sha256(lobe) for light, lobe in lobes.items()},
                    {light: lobe.radiance for light, lobe in lobes.items()})


def put_in_order(mesh: bpy.types.Mesh) -> None:
    """The same faces, without a UV map: Blender's UV Sphere makes them in another order each time."""
    corners = [vertex.co.copy() for vertex in mesh.vertices]
    faces = [list(face.vertices) for face in mesh.polygons]
    starts = [face.index(min(face)) for face in faces]
    is_smooth = mesh.polygons[0].use_smooth
    mesh.clear_geometry()
    mesh.from_pydata(corners, [], sorted(face[at:] + face[:at] for face, at in zip(faces, starts, strict=True)))
    if is_smooth:
        mesh.shade_smooth()


def sha256(data) -> str:
    """Of all arrays that a dataclass holds, as its fields are ordered, with their shapes and dtypes."""
    total = hashlib.sha256()

    def add(value) -> None:
        if is_dataclass(value):
            for field in fields(value):
                add(getattr(value, field.name))
        elif value is None:
            total.update(b"none")
        else:
            array = np.ascontiguousarray(value)
            total.update(f"{array.dtype.str}{array.shape}".encode())
            total.update(array.tobytes())
    add(data)
    return total.hexdigest()


def kind() -> tuple[str, str]:
    """What hashes are recorded by: Blender's version, and the kind of processor as in "GenuineIntel 6 207 AVX512"."""
    names = [platform.machine()]
    if Path("/proc/cpuinfo").is_file():
        lines = (line.partition(":") for line in Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines())
        entries = {key.strip(): value.strip() for key, _, value in lines}
        names = [entries[key] for key in ("vendor_id", "cpu family", "model") if key in entries] or names
    return ".".join(map(str, bpy.app.version)), " ".join((*names, torch.backends.cpu.get_cpu_capability()))


def read_hashes() -> dict[str, dict[str, dict[str, dict[str, str]]]]:
    """By scene, Blender's version, processor, and what they are of."""
    return json.loads(HASHES.read_text()) if HASHES.is_file() else {}


def read_copies() -> dict[str, np.ndarray]:
    """Pictures (h, w, 3) f16 as `copy` makes them, by copy_key."""
    return dict(np.load(COPIES)) if COPIES.is_file() else {}


def copy_key(name: str, light: str, version: str) -> str:
    """Of a scene in a light, as one version of Blender makes it: they cut polygons into triangles differently."""
    return f"{name}, {light}, {version}"


def find_copies(copies: dict[str, np.ndarray], name: str, light: str, version: str) -> list[np.ndarray]:
    """The copy of a Blender's own version, or else of any."""
    own = copies.get(copy_key(name, light, version))
    return [own] if own is not None else [each for key, each in copies.items() if key.startswith(f"{name}, {light}")]


def copy(picture: np.ndarray) -> np.ndarray:
    return picture[::STEP, ::STEP].astype(np.float16)


def is_close(picture: np.ndarray, recorded: np.ndarray) -> bool:
    """Whether a picture is, but for rounding, the one that a copy was recorded of."""
    recorded = recorded.astype(np.float32)
    off, mean = np.abs(picture[::STEP, ::STEP] - recorded), recorded.mean()
    near = (off <= WITHIN * (recorded + mean)).all(axis=-1)
    return near.mean() >= PIXELS and off.mean() <= MEAN * mean
