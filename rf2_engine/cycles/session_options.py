# SPDX-License-Identifier: GPL-3.0-or-later
"""What a session of Cycles renders."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import NamedTuple

from .. import compat
from .. import passes as pass_table
from ..frame_settings import Light
from ..sampling import Sampling
from .overrides import Overrides


class Catchers(Enum):
    """What shadow catchers are in a session."""

    SHOWN = auto()  # objects like any other
    CUT = auto()    # holes in the film
    CATCH = auto()  # shadow catchers


class CameraModel(NamedTuple):
    """The camera of a session: by default a pinhole where the scene has its camera, one moment, a transparent film.

    Cycles then gives coverage as alpha, while the Environment pass still holds the directly visible world (measured:
    Env = world * (1 - alpha) in both film modes), so an opaque film is combined + environment.
    """

    depth_of_field: bool = False     # as the scene has it
    motion_blur: bool = False        # as the scene has it
    transparent_glass: bool = False  # the film is transparent behind glass too
    opaque_film: bool = False        # alpha is 1, but for holdouts
    catchers: Catchers = Catchers.SHOWN
    move_cameras: Callable[[Overrides], None] | None = None

    @property
    def is_blurred(self) -> bool:
        return self.depth_of_field or self.motion_blur

    @property
    def visible_passes(self) -> tuple[str, ...]:
        """Keys of the passes whose directly visible radiance is in Combined."""
        return ("emission", "environment") if self.opaque_film else ("emission",)


PINHOLE = CameraModel()


class SessionOptions(NamedTuple):
    """The settings of one session."""

    sampling: Sampling
    light: Light
    camera: CameraModel = PINHOLE         # of Light.ALL the film alone: all else is the scene's
    denoise: bool = False                 # Combined of Light.ALL; traced light is denoised wherever Blender can
    has_volumes: bool = False             # smoke or fog leaves noise in the first hits, which must not pass for texture
    threads: int = 0                      # 0: as Blender is set
    groups: Sequence[pass_table.Pass] = ()  # passes of light groups that are rendered too

    @property
    def is_denoised(self) -> bool:
        """Whether traced light comes denoised, and with the noise that was removed."""
        return self.light is Light.TRACED and compat.has_openimagedenoise()

    @property
    def catches_shadows(self) -> bool:
        return self.camera.catchers is Catchers.CATCH
