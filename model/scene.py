# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderScene: the one data structure that crosses from Blender to the network.

Arrays only, numpy only. Everything is in one right-handed, Z-up frame (Blender's world) and in scene-linear
Rec.709 radiance, W/(m^2 sr). `rf2_engine/convert` fills it from a depsgraph, `tools/datagen` saves it as training
data and `model/renderer.py` renders it, so training and F12 see the same thing.
"""
from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from .fields import (
    COLOR,
    DIRECTION,
    DISPLACEMENT,
    EULER,
    LENGTH,
    PANORAMA,
    POINT,
    RADIANCE,
    Channels,
    array,
    check_arrays,
    layouts,
    rows,
)
from .panorama import Panorama

TILE_SIZE = 32
EMISSION_SIZE = 64  # of the grid that a picture is kept on, which is laid out as that of tiles
TILE = Channels(  # of a material tile: BSDF parameters, tangent-space normal, displacement
    1,
    base_color=(3, COLOR),  # scene-linear albedo, [0, 1]; more where a surface reflects more than arrives
    metallic=1,             # [0, 1]
    roughness=1,            # Blender's perceptual roughness, [0, 1]
    ior=1,                  # effective index at Specular IOR Level 1 (docs/scene-input.md 3.3), [1, 2.5]; of glass
                            # also less, from 0.4 on: air in water has 0.75
    transmission=1,         # [0, 1]
    normal=3,               # 2 * map - 1; (0, 0, 1) when there is no map
    height=(1, DISPLACEMENT),  # displacement / (0.025 world units) in [-1, 1]; 0 when there is none
)
TILE_CHANNELS = len(TILE)
BASE_COLOR, NORMAL = TILE["base_color"], TILE["normal"]
PARAMETERS = slice(NORMAL.start)  # of the BSDF
METALLIC, ROUGHNESS, IOR, TRANSMISSION, HEIGHT = map(
    TILE.index, ("metallic", "roughness", "ior", "transmission", "height"))

SHEEN = Channels(1, color=(3, COLOR), roughness=1)
OF_TILES = "translucent", "fibre", "sheen", "coat", "guessed", "single"  # optional fields of RenderScene, 0 by default
COAT = Channels(1, weight=1, f0=1, roughness=1, share=1)  # share: in the roughness of the surface as a whole
TWO_LOBES = Channels(1, diffuse=(3, COLOR), specular=(3, COLOR), roughness=1)  # as the published diffspec mapper reads

ENVIRONMENT_SHAPE = (256, 512, 3)
BOUNCES = 4, 4, 12, 12     # Blender's defaults: diffuse, glossy, transmission, all
ANY = 255                  # bounces: no limit
ALL_GROUPS = 2 ** 64 - 1   # of surfaces
HALF_SPACE = 0.0, 1e-3     # cosines of a beam that is everything in front of a flat light
TRANSPARENT = 0.5          # transmission from which on light passes
STRAIGHT = 1.05            # ior up to which it passes without a bend, and from the inverse of which on
CELLS, VOXELS = 8, 4  # of a volume's box along each axis, and of a cell


@dataclass
class Volumes:
    """Occupied 4x4x4-voxel cells of participating media, M tokens (docs/scene-input.md 5)."""

    density: np.ndarray = array("M", 64)                       # [0, 1], x fastest
    position: np.ndarray = array("M", 3, behaves=POINT)        # centre of the cell
    rotation: np.ndarray = array("M", 3, behaves=EULER)        # of the whole volume box
    scale: np.ndarray = array("M", 3, behaves=LENGTH)          # side lengths of the whole volume box
    scattering: np.ndarray = array("M", 3, behaves=COLOR)      # multipliers, per box (docs/scene-input.md 5.4)
    absorption: np.ndarray = array("M", 3, behaves=COLOR)

    def __len__(self) -> int:
        return len(self.density)

    @classmethod
    def concatenate(cls, parts: list[Volumes]) -> Volumes:
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


@dataclass
class View:
    """A camera at one point and the pixel rectangle it renders (docs/scene-input.md 1.3, 1.4).

    Usually a pinhole camera: pixel (row y, column x), row 0 on top, looks along
    ((x + 0.5 - principal_x) / focal_x, -(y + 0.5 - principal_y) / focal_y, -1) in camera space. Lens shift, sensor fit,
    pixel aspect, resolution percentage and render border are all expressed by focal and principal point.

    With a `panorama` that says where pixels look. Then focal is pixels per radian in the middle of the picture, and
    picture_size that of a pinhole picture of 90 degrees that is as fine.
    """

    camera_to_world: np.ndarray  # (4, 4) f32, rigid; columns are right, up, backward, position
    focal: np.ndarray            # (2,) f32, pixels
    principal: np.ndarray        # (2,) f32, pixels from the top left corner of this rectangle
    width: int
    height: int
    picture_size: int = 0        # pixels, the longer side of the whole picture; 0 when this rectangle is all of it
    corner: tuple[int, int] = (0, 0)  # x, y of the rectangle's top left pixel in the whole picture
    panorama: Panorama | None = None  # of the whole picture; a negative focal[0] mirrors its x axis, too
    clip_start: float = 0.0      # world units along its axis, or all rays of a panorama, before which it sees nothing

    @property
    def longer_side(self) -> int:
        """Pixels, of the whole picture: a render border shows the same pixels as the full frame."""
        return self.picture_size or max(self.width, self.height)

    @property
    def wraps(self) -> bool:
        """Whether the left and the right side of the rectangle are neighbours."""
        return self.panorama is not None and self.panorama.wraps and self.width == self.panorama.width


@dataclass
class Guides:
    """First-hit data of one view, and the light that was traced; row 0 is the top of the picture.

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
    # (H, W, 7) f16, channels of TILE before the normal at the pixel's centre; None = those of the token's texel there
    material: np.ndarray | None = None
    # (H, W, 3) f32, radiance of direct light and of what smooth mirrors and glass show, without a diffuse or volume
    # bounce, premultiplied; None = nothing was traced
    traced: np.ndarray | None = None
    # (H, W) bool, pixels whose traced light has all the noise of its samples; None: a denoiser took it away
    is_noisy: np.ndarray | None = None
    # (H, W, 3) f32, what the denoiser took away of `traced` and what is seen directly; None: no denoiser did
    noise: np.ndarray | None = None
    samples: np.ndarray | None = None  # (H, W) f32, of each pixel in the first hits and in `traced`; None: not known
    # (H, W) f32, share of `glossy_color` that gets out from between rough facets; None: all of it
    glossy_kept: np.ndarray | None = None
    # (H, W) f32, mean square by which normals differ in a pixel, as bumps do that are finer; None: not at all
    normal_variance: np.ndarray | None = None
    # (H, W) f32, share of a smooth matte surface's light that such bumps send on; None: all of it
    matte_share: np.ndarray | None = None
    # (H, W) bool, pixels whose transmission goes straight on: emission and environment show what shines behind them
    straight: np.ndarray | None = None
    # (H, W, 3), of the matte surfaces that reflections and refractions end at: place (f32, world), unit normal (f16),
    # diffuse colour times those of what was passed on the way (f16; 0 = no end). None = none in the picture
    reflected_position: np.ndarray | None = None
    reflected_normal: np.ndarray | None = None
    reflected_color: np.ndarray | None = None
    refracted_position: np.ndarray | None = None
    refracted_normal: np.ndarray | None = None
    refracted_color: np.ndarray | None = None
    reflected_group: np.ndarray | None = None  # (H, W, 1) f16, of surfaces, theirs; None where lights tell none apart
    refracted_group: np.ndarray | None = None
    # (H, W, 3) f32, radiance of the lamps and of the sky that they end at, times the same; of reflections that which is
    # seen by way of another surface. None as above
    reflected_light: np.ndarray | None = None
    refracted_light: np.ndarray | None = None
    # (H, W, 3), of metal that reflections meet first: place (f32, world), unit normal (f16), colour (f16; 0 = none);
    # and (H, W, 1) its roughness (f16). None as above
    mirrored_position: np.ndarray | None = None
    mirrored_normal: np.ndarray | None = None
    mirrored_color: np.ndarray | None = None
    mirrored_roughness: np.ndarray | None = None
    # The same of the dielectric layer, or the glass, that they meet first, and (H, W, 1) its reflectance at normal
    # incidence (f16)
    layer_position: np.ndarray | None = None
    layer_normal: np.ndarray | None = None
    layer_color: np.ndarray | None = None
    layer_roughness: np.ndarray | None = None
    layer_f0: np.ndarray | None = None
    # The same of rough glass that refractions leave first: place, axis of the lobe in which light leaves it, colours of
    # the glass on the way, and roughness of a mirror with this lobe
    exit_position: np.ndarray | None = None
    exit_normal: np.ndarray | None = None
    exit_color: np.ndarray | None = None
    exit_roughness: np.ndarray | None = None
    # The same of any glass that they leave after a reflection where they would leave it first
    inner_position: np.ndarray | None = None
    inner_normal: np.ndarray | None = None
    inner_color: np.ndarray | None = None
    inner_roughness: np.ndarray | None = None
    # The same of the first metal that paths meet, unless that is one of the above, and else of the dielectric layer on
    # what they end at: f0 is 1 of metal. And unit vectors (f16) to where it is seen from
    reflected_gloss_position: np.ndarray | None = None
    reflected_gloss_normal: np.ndarray | None = None
    reflected_gloss_color: np.ndarray | None = None
    reflected_gloss_roughness: np.ndarray | None = None
    reflected_gloss_f0: np.ndarray | None = None
    reflected_gloss_viewer: np.ndarray | None = None
    refracted_gloss_position: np.ndarray | None = None
    refracted_gloss_normal: np.ndarray | None = None
    refracted_gloss_color: np.ndarray | None = None
    refracted_gloss_roughness: np.ndarray | None = None
    refracted_gloss_f0: np.ndarray | None = None
    refracted_gloss_viewer: np.ndarray | None = None

    def __post_init__(self) -> None:
        h, w = self.depth.shape
        for name, value in self.arrays().items():
            if value.shape[:2] != (h, w):
                raise ValueError(f"guide {name} has shape {value.shape}, expected ({h}, {w}, ...)")

    @property
    def glossy_albedo(self) -> np.ndarray:
        """(H, W, 3) f32, of the glossy lobe."""
        return self.glossy_color if self.glossy_kept is None else self.glossy_color * self.glossy_kept[..., None]

    def arrays(self) -> dict[str, np.ndarray]:
        """By name, those that are there."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) is not None}

    def rows(self, rows: slice) -> Guides:
        """The guides of some rows of the picture; shared memory."""
        return Guides(**{name: array[rows] for name, array in self.arrays().items()})


@dataclass
class Geometry:
    """The real surfaces of a scene, which rays meet: G triangles, each with the token triangle that stands for it.

    The token has its material, light and visibility: what a ray finds on a triangle is that of the nearest point of
    the token (model/shading.py).
    """

    triangles: np.ndarray = rows("G", 3, 3, behaves=POINT)    # corners, counter-clockwise from the front
    normals: np.ndarray = rows("G", 3, 3, behaves=DIRECTION)  # unit shading normal per corner
    token: np.ndarray = rows("G", dtype=np.int32)             # row of the scene's token triangles

    def __len__(self) -> int:
        return len(self.triangles)


@dataclass
class Fire:
    """Light that media send out, F cubes."""

    position: np.ndarray = array("F", 3, behaves=POINT)      # middle
    radiance: np.ndarray = array("F", 3, behaves=RADIANCE)   # of a ray along an edge
    size: np.ndarray = array("F", behaves=LENGTH)            # of an edge

    def __len__(self) -> int:
        return len(self.position)

    @classmethod
    def concatenate(cls, parts: list[Fire]) -> Fire:
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))


SELDOM = {"light_bounces": np.uint8(ANY), "lit_groups": np.uint64(ALL_GROUPS),
          "blockers": np.uint64(ALL_GROUPS), "group": np.uint8(0), "is_holdout": np.False_, "shadow_tile": np.int32(-1),
          "is_rough_guess": np.False_, "emission_tile": np.int32(-1), "softened": np.float32(1)}


@dataclass
class RenderScene:
    """A scene for the network: N triangles, T material tiles, one environment, M volume cells.

    And, as `geometry`, what rays meet. Float arrays are f32, tiles f16, `tile_index` i32.
    """

    triangles: np.ndarray = rows("N", 3, 3, behaves=POINT)     # corners, counter-clockwise from the front
    normals: np.ndarray = rows("N", 3, 3, behaves=DIRECTION)   # unit shading normal per corner
    emission: np.ndarray = rows("N", 3, behaves={COLOR: -1, RADIANCE: -1})  # radiance >= 0; > 0 makes it a light
    beam_axis: np.ndarray = rows("N", 3, behaves=DIRECTION)    # of a light's beam; 0 = radiates everywhere
    # Cosines (outer, inner): emission is scaled by smoothstep(outer, inner, cos(angle to axis)), or if `inner` is
    # beams.SPREAD as an area lamp with a spread; ignored without an axis
    beam_cosine: np.ndarray = rows("N", 2)
    tile_index: np.ndarray = rows("N", dtype=np.int32)         # row of `tiles`
    # BSDF parameters on the barycentric grid of docs/scene-input.md 4.2
    tiles: np.ndarray = rows("T", TILE_CHANNELS, TILE_SIZE, TILE_SIZE, dtype=np.float16, channels=TILE)
    environment: np.ndarray | None = array(  # radiance, rotation and strength applied
        *ENVIRONMENT_SHAPE, behaves={COLOR: -1, RADIANCE: -1, PANORAMA: 1}, default="none")
    volumes: Volumes | None = None
    fire: Fire | None = None  # the network is not told of it
    # Radiance of surfaces that are no lights, because they reflect more than that; None = 0. The network is not told
    glow: np.ndarray | None = array("N", 3, behaves={COLOR: -1, RADIANCE: -1}, default="none")
    seen: np.ndarray | None = array("N", dtype=bool, default="none")  # by cameras, lamps are not; None = all
    # Rays that do not meet a triangle, a set of surface_kinds.Ray, of cameras too; None = all meet all
    hidden: np.ndarray | None = array("N", dtype=np.uint8, default="none")
    # Most bounces of the light of a triangle that shines, and the groups of surfaces that it lights, bits; None = ANY,
    # ALL_GROUPS. A lamp's or emitter's light goes on rays from which it is not `hidden`
    light_bounces: np.ndarray | None = array("N", dtype=np.uint8, default="none")
    lit_groups: np.ndarray | None = array("N", dtype=np.uint64, default="none")
    # Groups of surfaces that stop its light, bits; None = ALL_GROUPS; 0: no shadows, nor do media dim it
    blockers: np.ndarray | None = array("N", dtype=np.uint64, default="none")
    # Of lamps, whether they shine in other directions, or fall off otherwise, than beams and squares say; None = no
    is_rough_guess: np.ndarray | None = array("N", dtype=np.bool_, default="none")
    # Of lamps with Soft Falloff, which shine as a disk that faces each place: the factor of that at the middle of the
    # scene, which is in their emission already; None = 1, of all others
    softened: np.ndarray | None = array("N", default="none")
    group: np.ndarray | None = array("N", dtype=np.uint8, default="none")  # of surfaces; None = 0
    is_holdout: np.ndarray | None = array("N", dtype=np.bool_, default="none")  # cuts a hole into the film; None = no
    # Row of `tiles` that a camera sees where that differs from what light meets; None = the same
    camera_tile: np.ndarray | None = array("N", dtype=np.int32, default="none")
    back_tile: np.ndarray | None = array("N", dtype=np.int32, default="none")  # of its back; None = the same
    # That which shadow rays pass straight through by a Light Path node, -1 for none; None = all -1
    shadow_tile: np.ndarray | None = array("N", dtype=np.int32, default="none")
    # Row of `emission_tiles`, -1 where emission is the same all over a triangle; None = all -1
    emission_tile: np.ndarray | None = array("N", dtype=np.int32, default="none")
    # Emission, or glow, on a barycentric grid, over that of the triangle. The network is not told
    emission_tiles: np.ndarray | None = array("S", 3, EMISSION_SIZE, EMISSION_SIZE, dtype=np.float16,
                                              behaves={COLOR: 1}, default="none")
    # Lowest and highest corner of the box that becomes the network's, what a camera looks at; None = all but lights
    box: np.ndarray | None = array(2, 3, behaves=POINT, default="none")
    # Rays that do not see the environment's light, a set of surface_kinds.Ray; None = all do
    environment_hidden: np.ndarray | None = array(1, dtype=np.uint8, default="none")
    # What some rays see in place of `environment`, and which, sets of surface_kinds.Ray; None = all see the same
    other_environments: np.ndarray | None = array(
        "E", *ENVIRONMENT_SHAPE, behaves={COLOR: -1, RADIANCE: -1, PANORAMA: 2}, default="none")
    other_rays: np.ndarray | None = array("E", dtype=np.uint8, default="none")
    # Most diffuse, glossy, transmission and all bounces of light; None = BOUNCES
    bounces: np.ndarray | None = array(4, dtype=np.int32, default="none")
    # Whether glossy surfaces, and glass, send light on to matte ones; None = they do
    caustics: np.ndarray | None = array(2, dtype=np.bool_, default="none")
    # Factor on all radiance for the network; None = by how much light there is
    exposure: np.ndarray | None = array(1, default="none")
    # Nine-number appearance of the published network in place of a tile's parameters; 0 where there is none
    latents: np.ndarray | None = array("T", 9, default="none")
    # Diffuse and specular reflectance of tiles that the parameters show as one surface in between; 0 for others
    two_lobes: np.ndarray | None = array("T", len(TWO_LOBES), TILE_SIZE, TILE_SIZE, dtype=np.float16,
                                         channels=TWO_LOBES, default="none")
    # Share of a tile's diffuse light that goes to the other side, by colour; None = nothing
    translucent: np.ndarray | None = array("T", 3, behaves={COLOR: -1}, default="none")
    # Share of a tile's diffuse light that hair scatters, which Cycles' passes have as gloss; None = nothing
    fibre: np.ndarray | None = array("T", default="none")
    # Share of the light that passes a tile straight; None = what it transmits, if its IOR bends nothing
    clear: np.ndarray | None = array("T", 3, behaves={COLOR: -1}, default="none")
    # Colour and roughness of a tile's sheen (material/sheen.py), whose mean is in its base colour; None = nothing
    sheen: np.ndarray | None = array("T", len(SHEEN), channels=SHEEN, default="none")
    # Clear coat of a tile, which its other values contain; None = nothing
    coat: np.ndarray | None = array("T", len(COAT), channels=COAT, default="none")
    # Share of a tile's light whose lobe has another shape than estimates know; None = nothing
    guessed: np.ndarray | None = array("T", default="none")
    # Share of a tile's gloss whose facets do not light each other (GGX without multiple scattering); None = nothing
    single: np.ndarray | None = array("T", default="none")
    # Light group of what a triangle and the environment emit, counted from 1; 0 or None = none
    light_group: np.ndarray | None = array("N", dtype=np.int32, default="none")
    environment_group: np.ndarray | None = array(1, dtype=np.int32, default="none")
    geometry: Geometry | None = None  # None: the token triangles are the real ones
    # Lamps of negative strength, as a scene of their own, whose emission is what they take away. No network is told
    negative: RenderScene | None = None

    def __len__(self) -> int:
        return len(self.triangles)

    @property
    def surfaces(self) -> Geometry:
        """What rays meet."""
        return self.geometry or Geometry(self.triangles, self.normals, np.arange(len(self), dtype=np.int32))

    @property
    def environments(self) -> list[tuple[int, np.ndarray]]:
        """Rays, a set of surface_kinds.Ray, and the environment that they see; others see none."""
        if self.environment is None:
            return []
        seen = 255 & ~(0 if self.environment_hidden is None else int(self.environment_hidden[0]))
        others = [] if self.other_rays is None else [
            (seen & int(rays), seen_by_them) for rays, seen_by_them in zip(self.other_rays, self.other_environments)]
        return [(seen & ~sum(rays for rays, _ in others), self.environment), *others]

    @property
    def is_light(self) -> np.ndarray:
        """(N,) bool."""
        return (self.emission > 0).any(axis=1)

    @property
    def surface_glow(self) -> np.ndarray:
        """(N, 3) f32, 0 where nothing glows."""
        return np.zeros_like(self.emission) if self.glow is None else self.glow

    @property
    def light_groups(self) -> np.ndarray:
        """(N,) i32 light group of each triangle, 0 = none."""
        return np.zeros(len(self), np.int32) if self.light_group is None else self.light_group

    @property
    def is_seen(self) -> np.ndarray:
        """(N,) bool: triangles that a camera sees."""
        return np.ones(len(self), bool) if self.seen is None else self.seen

    @property
    def hidden_from(self) -> np.ndarray:
        """(N,) u8, as `hidden`."""
        return np.zeros(len(self), np.uint8) if self.hidden is None else self.hidden

    @property
    def most_bounces(self) -> dict[str, int]:
        """Of light: "diffuse", "glossy", "transmission" and "all"."""
        return dict(zip(("diffuse", "glossy", "transmission", "all"),
                        BOUNCES if self.bounces is None else self.bounces.tolist(), strict=True))

    @property
    def has_caustics(self) -> dict[str, bool]:
        """Whether there are "reflective" and "refractive" ones."""
        return dict(zip(("reflective", "refractive"), (True, True) if self.caustics is None else self.caustics.tolist(),
                        strict=True))

    @property
    def seen_tile(self) -> np.ndarray:
        """(N,) i32 row of `tiles` that a camera sees."""
        return self.tile_index if self.camera_tile is None else self.camera_tile

    @property
    def tile_behind(self) -> np.ndarray:
        """(N,) i32 row of `tiles` of the backs of triangles."""
        return self.tile_index if self.back_tile is None else self.back_tile

    def tiles_met(self, token: np.ndarray, is_behind: np.ndarray) -> np.ndarray:
        """(P,) i32 row of `tiles` of token triangles (P,), of the side that is met, from behind or not (P,)."""
        return np.where(is_behind, self.tile_behind[token], self.tile_index[token])

    def seldom(self, name: str) -> np.ndarray:
        """(N,) an array of SELDOM, with its default where there is none."""
        values = getattr(self, name)
        return np.full(len(self), SELDOM[name]) if values is None else values

    def of_tiles(self, name: str) -> np.ndarray:
        """(T, ...) f32 a field of OF_TILES, 0 where there is none."""
        values, (_, *shape) = getattr(self, name), layouts(self)[name].shape
        return np.zeros((len(self.tiles), *shape), np.float32) if values is None else values

    @property
    def tile_latents(self) -> np.ndarray:
        """(T, 9) f32, 0 where a tile has none."""
        return np.zeros((len(self.tiles), 9), np.float32) if self.latents is None else self.latents

    @property
    def tile_clear(self) -> np.ndarray:
        """(T, 3) f32, as `clear`."""
        if self.clear is not None:
            return self.clear
        clear, rows = np.zeros((len(self.tiles), 3), np.float32), np.flatnonzero(passing(self.tiles) > TRANSPARENT)
        ior = self.tiles[rows, IOR].mean(axis=(1, 2), dtype=np.float32)
        rows = rows[np.maximum(ior, 1 / ior.clip(1e-3)) < STRAIGHT]
        clear[rows] = tile_tints(self.tiles[rows])
        return clear

    @property
    def tile_lobes(self) -> np.ndarray:
        """(T, 7, 32, 32) f16, 0 where a tile has none; without any a view that takes no memory."""
        if self.two_lobes is not None:
            return self.two_lobes
        return np.broadcast_to(np.float16(0), (len(self.tiles), len(TWO_LOBES), TILE_SIZE, TILE_SIZE))

    def validate(self) -> None:
        """Check shapes, dtypes and finiteness.

        Raises ValueError naming the array that breaks the contract above.
        """
        check_arrays(self)
        if self.volumes is not None:
            check_arrays(self.volumes, "volumes.")
        if self.fire is not None:
            check_arrays(self.fire, "fire.")
        if self.geometry is not None:
            check_arrays(self.geometry, "geometry.")
            token = self.geometry.token
            if len(token) and (token.min() < 0 or token.max() >= len(self)):
                raise ValueError(f"geometry.token reaches outside the {len(self)} triangles")
        if len(self) and (self.tile_index.min() < 0 or self.tile_index.max() >= len(self.tiles)):
            raise ValueError(f"tile_index reaches outside the {len(self.tiles)} tiles")

    def appended(self, *others: RenderScene) -> RenderScene:
        """This scene with the triangles (and the tiles they use) of `others` behind its own."""
        scenes, tiles, count, geometries, emission_tiles = [], 0, 0, [], []
        optional = ("latents", "two_lobes", "clear", *OF_TILES, "hidden", "camera_tile", "back_tile", "light_group",
                    "glow", *SELDOM)
        absent = [name for name in optional
                  if all(getattr(scene, name) is None for scene in (self, *others))]
        for scene in (self, *others):
            shadow_tile, emission_tile = scene.seldom("shadow_tile"), scene.seldom("emission_tile")
            before = np.int32(sum(map(len, emission_tiles)))
            emission_tiles += [] if scene.emission_tiles is None else [scene.emission_tiles]
            scenes.append(replace(scene, tile_index=scene.tile_index + np.int32(tiles), seen=scene.is_seen,
                                  camera_tile=scene.seen_tile + np.int32(tiles),
                                  back_tile=scene.tile_behind + np.int32(tiles), hidden=scene.hidden_from,
                                  shadow_tile=np.where(shadow_tile < 0, shadow_tile, shadow_tile + np.int32(tiles)),
                                  **{name: scene.seldom(name) for name in SELDOM if not name.endswith("_tile")},
                                  emission_tile=np.where(emission_tile < 0, emission_tile, emission_tile + before),
                                  light_group=scene.light_groups, glow=scene.surface_glow,
                                  latents=scene.tile_latents, two_lobes=scene.tile_lobes,
                                  clear=scene.tile_clear, **{name: scene.of_tiles(name) for name in OF_TILES}))
            surfaces = scene.surfaces
            geometries.append(replace(surfaces, token=surfaces.token + np.int32(count)))
            tiles, count = tiles + len(scene.tiles), count + len(scene)
        geometry = None
        if any(scene.geometry is not None for scene in scenes):
            geometry = Geometry(**{name: np.concatenate([getattr(part, name) for part in geometries])
                                   for name in layouts(self.surfaces)})
        emission_tiles = np.concatenate(emission_tiles) if emission_tiles else None
        joined = {name: np.concatenate([getattr(scene, name) for scene in scenes])
                  for name, layout in layouts(self).items() if layout.shape[0] in ("N", "T") and name not in absent}
        return replace(self, geometry=geometry, emission_tiles=emission_tiles, **joined)


def constant_tile(base_color=(0.8, 0.8, 0.8), metallic=0.0, roughness=1.0, ior=1.0, transmission=0.0) -> np.ndarray:
    """(11, 32, 32) f16 tile of a homogeneous material without normal map or displacement."""
    tile = np.zeros((TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
    tile[BASE_COLOR] = np.reshape(base_color, (3, 1, 1))
    tile[METALLIC], tile[ROUGHNESS], tile[IOR], tile[TRANSMISSION] = metallic, roughness, ior, transmission
    tile[NORMAL] = np.reshape((0.0, 0.0, 1.0), (3, 1, 1))
    return tile


def tile_means(tiles: np.ndarray) -> np.ndarray:
    """(T, C) f32 means of tiles (T, C, 32, 32) over their triangle, beyond which they go on."""
    return tiles.mean(axis=(2, 3), dtype=np.float32, where=cells_inside())


def passing(tiles: np.ndarray) -> np.ndarray:
    """(T,) f32 mean share of light that passes tiles (T, 11, 32, 32), straight or not, whatever their colour."""
    transmission, metallic = tile_means(tiles[:, (TRANSMISSION, METALLIC)]).T
    return (1 - metallic) * transmission


def tile_tints(tiles: np.ndarray) -> np.ndarray:
    """(T, 3) f32 the same of each colour."""
    return passing(tiles)[:, None] * tint_of_glass(tile_means(tiles[:, BASE_COLOR]))


def tint_of_glass(base_color: np.ndarray) -> np.ndarray:
    """(..., 3) share of light that a surface of glass with this Base Color lets through: two are the colour."""
    return np.sqrt(base_color)


def cells_inside(size: int = TILE_SIZE) -> np.ndarray:
    """(size, size) bool: cells of a tile that are in its triangle."""
    return np.add.outer(np.arange(size), np.arange(size)) < size


def texels(weights: np.ndarray, size: int = TILE_SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (...,) i64 of a tile at weights (..., 2) of corners 0 and 1 (docs/scene-input.md 4.2)."""
    x, y = np.moveaxis((weights * size).astype(np.int64).clip(0, size - 1), -1, 0)
    return x, y


def barycentric_grid(size: int = TILE_SIZE) -> np.ndarray:
    """(32, 32, 3) f32 corner weights at [row, column]; the third may be negative (docs/scene-input.md 4.2)."""
    centre = (np.arange(size, dtype=np.float32) + 0.5) / size
    w0, w1 = np.meshgrid(centre, centre, indexing="xy")
    return np.stack([w0, w1, 1 - w0 - w1], axis=-1)
