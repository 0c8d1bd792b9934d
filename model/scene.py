# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderScene: the one data structure that crosses from Blender to the network.

Arrays only, numpy only. Everything is in one right-handed, Z-up frame (Blender's world) and in scene-linear
Rec.709 radiance, W/(m^2 sr). `rf2_engine/convert` fills it from a depsgraph, `tools/datagen` saves it as training
data and `model/renderer.py` renders it, so training and F12 see the same thing.
"""
from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np

TILE_SIZE = 32
TILE_CHANNELS = 11
BASE_COLOR = slice(0, 3)   # scene-linear albedo, [0, 1]
METALLIC = 3               # [0, 1]
ROUGHNESS = 4              # Blender's perceptual roughness, [0, 1]
IOR = 5                    # effective index at Specular IOR Level 1 (spec/scene-input.md 3.3), [1, 2.5]
TRANSMISSION = 6           # [0, 1]
NORMAL = slice(7, 10)      # tangent-space normal, 2 * map - 1; (0, 0, 1) when there is no map
HEIGHT = 10                # displacement / (0.025 world units) in [-1, 1]; 0 when there is none

ENVIRONMENT_SHAPE = (256, 512, 3)


@dataclass
class Volumes:
    """Occupied 4x4x4-voxel cells of participating media, M tokens (spec/scene-input.md 5)."""

    density: np.ndarray     # (M, 64) f32, [0, 1], x fastest
    position: np.ndarray    # (M, 3) f32, world centre of the cell
    rotation: np.ndarray    # (M, 3) f32, Euler XYZ radians of the whole volume box
    scale: np.ndarray       # (M, 3) f32, world side lengths of the whole volume box
    scattering: np.ndarray  # (M, 3) f32, RGB coefficient multipliers, per box (spec/scene-input.md 5.4)
    absorption: np.ndarray  # (M, 3) f32

    def __len__(self) -> int:
        return len(self.density)

    @classmethod
    def concatenate(cls, parts: list["Volumes"]) -> "Volumes":
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


@dataclass
class View:
    """A pinhole camera and the pixel rectangle it renders (spec/scene-input.md 1.3, 1.4).

    Pixel (row y, column x), row 0 on top, looks along
    ((x + 0.5 - principal_x) / focal_x, -(y + 0.5 - principal_y) / focal_y, -1) in camera space. Lens shift, sensor fit,
    pixel aspect, resolution percentage and render border are all expressed by focal and principal point.
    """

    camera_to_world: np.ndarray  # (4, 4) f32, rigid; columns are right, up, backward, position
    focal: np.ndarray            # (2,) f32, pixels
    principal: np.ndarray        # (2,) f32, pixels from the top left corner of this rectangle
    width: int
    height: int
    picture_size: int = 0        # pixels, the longer side of the whole picture; 0 when this rectangle is all of it
    corner: tuple[int, int] = (0, 0)  # x, y of the rectangle's top left pixel in the whole picture


@dataclass
class Guides:
    """First-hit data of one view; row 0 is the top of the picture. No lighting in here.

    Colours and alpha are means over the samples of a pixel, so colours are premultiplied by coverage (a pixel half
    covered by a white wall holds 0.5). Position, depth and the triangle belong to the pixel's centre, or to the nearest
    hit where the centre misses what covers the rest of the pixel.
    """

    position: np.ndarray            # (H, W, 3) f32, world; 0 where nothing is hit
    normal: np.ndarray              # (H, W, 3) f32, unit mean, world, facing the camera or not as shaded; 0 = no hit
    diffuse_color: np.ndarray       # (H, W, 3) f32
    glossy_color: np.ndarray        # (H, W, 3) f32
    transmission_color: np.ndarray  # (H, W, 3) f32
    emission: np.ndarray            # (H, W, 3) f32, radiance of emitters seen directly
    environment: np.ndarray         # (H, W, 3) f32, world radiance seen directly, premultiplied by (1 - alpha)
    depth: np.ndarray               # (H, W) f32, Blender's Depth pass
    alpha: np.ndarray               # (H, W) f32, coverage in [0, 1]
    hit_triangle: np.ndarray        # (H, W) i32, token triangle behind the pixel centre; -1 = none
    hit_barycentric: np.ndarray     # (H, W, 2) f32, weights of corners 0 and 1 of that triangle

    def __post_init__(self) -> None:
        h, w = self.depth.shape
        for f in fields(self):
            if getattr(self, f.name).shape[:2] != (h, w):
                raise ValueError(f"guide {f.name} has shape {getattr(self, f.name).shape}, expected ({h}, {w}, ...)")


def _none(*shape: int, dtype=np.float32):
    return field(default_factory=lambda: np.zeros(shape, dtype))


@dataclass
class RenderScene:
    """Everything the network is told about a scene: N triangles, T material tiles, one environment, M volume cells."""

    triangles: np.ndarray = _none(0, 3, 3)        # (N, 3, 3) f32, corner positions, counter-clockwise from the front
    normals: np.ndarray = _none(0, 3, 3)          # (N, 3, 3) f32, unit shading normal per corner
    emission: np.ndarray = _none(0, 3)            # (N, 3) f32, radiance >= 0 leaving the triangle; > 0 makes it a light
    beam_axis: np.ndarray = _none(0, 3)           # (N, 3) f32, unit axis of a light's beam; 0 = radiates everywhere
    beam_cosine: np.ndarray = _none(0, 2)         # (N, 2) f32, cosines (outer, inner): emission is scaled by
    #                                               smoothstep(outer, inner, cos(angle to axis)); ignored if axis is 0
    tile_index: np.ndarray = _none(0, dtype=np.int32)                        # (N,) i32, row of `tiles`
    tiles: np.ndarray = _none(0, TILE_CHANNELS, TILE_SIZE, TILE_SIZE, dtype=np.float16)  # (T, 11, 32, 32) f16
    #                                               BSDF parameters on the barycentric grid of spec/scene-input.md 4.2
    environment: np.ndarray | None = None         # (256, 512, 3) f32, radiance, rotation and strength applied
    volumes: Volumes | None = None

    def __len__(self) -> int:
        return len(self.triangles)

    @property
    def is_light(self) -> np.ndarray:
        """(N,) bool."""
        return (self.emission > 0).any(axis=1)

    def validate(self) -> None:
        """Check shapes, dtypes and finiteness.

        Raises ValueError naming the array that breaks the contract above.
        """
        n, t = len(self.triangles), len(self.tiles)
        expected = {
            "triangles": ((n, 3, 3), np.float32), "normals": ((n, 3, 3), np.float32), "emission": ((n, 3), np.float32),
            "beam_axis": ((n, 3), np.float32), "beam_cosine": ((n, 2), np.float32), "tile_index": ((n,), np.int32),
            "tiles": ((t, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16),
        }
        if self.environment is not None:
            expected["environment"] = (ENVIRONMENT_SHAPE, np.float32)
        for name, (shape, dtype) in expected.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != dtype:
                raise ValueError(f"{name} is {array.dtype}{array.shape}, expected {np.dtype(dtype)}{shape}")
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise ValueError(f"{name} holds values that are not finite")
        if n and (self.tile_index.min() < 0 or self.tile_index.max() >= t):
            raise ValueError(f"tile_index reaches outside the {t} tiles")

    def appended(self, other: "RenderScene") -> "RenderScene":
        """This scene with the triangles (and the tiles they use) of `other` behind its own."""
        joined = {name: np.concatenate([getattr(self, name), getattr(other, name)])
                  for name in ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tiles")}
        index = np.concatenate([self.tile_index, other.tile_index + np.int32(len(self.tiles))])
        return replace(self, tile_index=index, **joined)


def constant_tile(base_color=(0.8, 0.8, 0.8), metallic=0.0, roughness=1.0, ior=1.0, transmission=0.0) -> np.ndarray:
    """(11, 32, 32) f16 tile of a homogeneous material without normal map or displacement."""
    tile = np.zeros((TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
    tile[BASE_COLOR] = np.reshape(base_color, (3, 1, 1))
    tile[METALLIC], tile[ROUGHNESS], tile[IOR], tile[TRANSMISSION] = metallic, roughness, ior, transmission
    tile[NORMAL] = np.reshape((0.0, 0.0, 1.0), (3, 1, 1))
    return tile


def barycentric_grid() -> np.ndarray:
    """(32, 32, 3) f32 corner weights at [row, column]; the third may be negative (spec/scene-input.md 4.2)."""
    centre = (np.arange(TILE_SIZE, dtype=np.float32) + 0.5) / TILE_SIZE
    w0, w1 = np.meshgrid(centre, centre, indexing="xy")
    return np.stack([w0, w1, 1 - w0 - w1], axis=-1)
