# SPDX-License-Identifier: GPL-3.0-or-later
"""Declare arrays with their behaviour, so that code that moves, recolours or checks a scene needs no list of names.

    triangles: np.ndarray = array("N", 3, 3, behaves=POINT)
    moved = mapped(scene, {POINT: lambda x: x - center})

It works for numpy arrays and torch tensors alike.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum, auto
from functools import partial

import numpy as np


class Behaviour(Enum):
    """What one axis of an array holds (by default the last one), or what every element is."""

    POINT = auto()      # x, y, z of a position
    DIRECTION = auto()  # x, y, z of a unit vector in the world
    EULER = auto()      # XYZ angles in radians
    LENGTH = auto()     # world units, in every element
    DISPLACEMENT = auto()  # likewise, clipped to -1 and 1
    COLOR = auto()      # R, G, B, or several such triples
    RADIANCE = auto()   # R, G, B that exposure scales
    PANORAMA = auto()   # columns of a latitude-longitude map, or of a stack of them


POINT, DIRECTION, EULER, LENGTH, DISPLACEMENT, COLOR, RADIANCE, PANORAMA = Behaviour


class Channels:
    """Named parts of an axis, in order: Channels(1, normal=(3, DIRECTION), alpha=1)["normal"] is a slice of axis 1."""

    def __init__(self, axis: int, **parts: int | tuple[int, Behaviour]):
        self.axis, self.parts, self.length = axis, {}, 0
        for name, size in parts.items():
            size, behaviour = size if isinstance(size, tuple) else (size, None)
            self.parts[name] = slice(self.length, self.length + size), behaviour
            self.length += size

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, name: str) -> slice:
        return self.parts[name][0]

    def without(self, name: str) -> Channels:
        """All parts but one."""
        return Channels(self.axis, **{key: part for key, part in self.sizes().items() if key != name})

    def joined(self, **parts: int | tuple[int, Behaviour]) -> Channels:
        """These parts, and more after them."""
        return Channels(self.axis, **self.sizes(), **parts)

    def sizes(self) -> dict[str, tuple[int, Behaviour | None]]:
        """Length and behaviour of each part, of which `Channels` of another axis can be made."""
        return {name: (part.stop - part.start, behaviour) for name, (part, behaviour) in self.parts.items()}

    def index(self, name: str) -> int:
        """Index of a part that is one channel."""
        return self[name].start


@dataclass(frozen=True)
class Layout:
    """Shape (letters stand for counts), dtype and behaviour {what: axis} of an array field."""

    shape: tuple[int | str, ...]
    dtype: np.dtype
    behaves: dict[Behaviour, int]
    channels: Channels | None = None


def array(*shape: int | str, dtype=np.float32, behaves: Behaviour | dict[Behaviour, int] | None = None,
          channels: Channels | None = None, default: str = ""):
    """A dataclass field for an array; `default`: "empty" (no rows), "none", or "" for no default."""
    behaves = behaves if isinstance(behaves, dict) else {} if behaves is None else {behaves: -1}
    empty = tuple(0 if isinstance(size, str) else size for size in shape)
    defaults = {"": {}, "none": {"default": None}, "empty": {"default_factory": lambda: np.zeros(empty, dtype)}}
    return field(**defaults[default], metadata={"layout": Layout(shape, np.dtype(dtype), behaves, channels)})


rows = partial(array, default="empty")


def layouts(group) -> dict[str, Layout]:
    """Layouts of those fields of a dataclass, or of an instance, that `array` made."""
    return {f.name: f.metadata["layout"] for f in fields(group) if "layout" in f.metadata}


def map_arrays(group, changes: dict[Behaviour, Callable]):
    """A copy in which changes[behaviour] is applied to all arrays of that behaviour, nested groups included.

    A function takes the array with the axis in question last, and returns the same shape, or its very argument for no
    change. A field with several behaviours is changed by each of them.
    """
    return map_layouts(group, lambda value, layout: _changed(value, layout, changes))


def map_layouts(group, change: Callable):
    """A copy in which all arrays are change(array, its Layout), nested groups included."""
    values = {}
    for f in fields(group):
        value, layout = getattr(group, f.name), f.metadata.get("layout")
        if is_dataclass(value):
            values[f.name] = map_layouts(value, change)
        elif value is not None and layout is not None:
            values[f.name] = change(value, layout)
    return replace(group, **values)


def map_channels(value, channels: Channels, changes: dict[Behaviour, Callable]):
    """`map_arrays` for one array that has these channels."""
    results = []
    for part, behaviour in channels.parts.values():
        if behaviour in changes:
            before = value[(slice(None),) * channels.axis + (part,)]
            after = _along(channels.axis, before, changes[behaviour])
            if after is not before:
                results.append((part, after))
    if results:
        value = value.clone() if hasattr(value, "clone") else value.copy()
        for part, after in results:
            value[(slice(None),) * channels.axis + (part,)] = after
    return value


def _changed(value, layout: Layout, changes: dict[Behaviour, Callable]):
    for behaviour, axis in layout.behaves.items():
        if behaviour in changes:
            value = _along(axis, value, changes[behaviour])
    return value if layout.channels is None else map_channels(value, layout.channels, changes)


def _along(axis: int, value, function: Callable):
    if axis == -1:
        return function(value)
    move = type(value).movedim if hasattr(value, "movedim") else np.moveaxis
    last = move(value, axis, -1)
    result = function(last)
    return value if result is last else move(result, -1, axis)


def check_arrays(group, name: str = "") -> None:
    """Shapes, dtypes and finiteness of all array fields; the same letter stands for the same count.

    Raises ValueError naming the array.
    """
    counts: dict[str, int] = {}
    for key, layout in layouts(group).items():
        value, where = getattr(group, key), f"{name}{key}"
        if value is None:
            continue
        expected = tuple(counts.setdefault(size, value.shape[i] if i < value.ndim else 0)
                         if isinstance(size, str) else size for i, size in enumerate(layout.shape))
        if value.shape != expected or value.dtype != layout.dtype:
            raise ValueError(f"{where} is {value.dtype}{value.shape}, expected {layout.dtype}{expected}")
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise ValueError(f"{where} holds values that are not finite")
