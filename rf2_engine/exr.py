# SPDX-License-Identifier: GPL-3.0-or-later
"""Multilayer EXR files as Blender writes them without compression: one part, scanlines from the top.

Blender's Python gives no access to the passes of a render result or of a loaded multilayer EXR, but Blender saves both
as such files; so nothing else has to be understood here.
"""
from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

MAGIC = 20000630
TILED, MULTIPART = 0x200, 0x1000
NO_COMPRESSION, TOP_TO_BOTTOM = 0, 0
PIXEL_TYPES = ("<u4", "<f2", "<f4")


class Multilayer(NamedTuple):
    # {(layer, pass): {channel: (H, W)}}, row 0 on top; passes of all views of stereoscopy but the first have the view
    # in their name: "Combined.right"
    passes: dict[tuple[str, str], dict[str, np.ndarray]]
    metadata: dict[str, str]
    views: list[str]  # of stereoscopy, the first that is shown at first; none without

    def split_view(self, name: str) -> tuple[str, str]:
        """A pass as its first view has it, and the name of the view that it is of: "" for the first."""
        first, _, view = name.rpartition(".")
        return (first, view) if view in self.views[1:] else (name, "")


def read(path: Path) -> Multilayer:
    """Raises ValueError for a file that Blender did not write as above, OSError if it cannot be read."""
    data = np.fromfile(path, np.uint8)
    attributes, end = _header(memoryview(data))
    left, bottom, right, top = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, top - bottom + 1
    channels = _channels(attributes["channels"])
    row = np.dtype([("y", "<i4"), ("size", "<i4"), *((name, kind, (width,)) for name, kind in channels)])
    rows = data[end + 8 * height:end + (8 + row.itemsize) * height].view(row)  # behind the table of offsets
    passes, views = {}, _views(attributes.get("multiView", b""))
    for name, _ in channels:
        stem, _, channel = name.rpartition(".")
        stem, view = _split(stem, views)
        layer, _, pass_name = stem.rpartition(".")
        passes.setdefault((layer, (pass_name or "Combined") + view), {})[channel] = rows[name]
    return Multilayer(passes, {name: value.decode(errors="replace") for name, value in attributes.items()
                               if name not in ("channels", "dataWindow", "multiView")}, views)


def _split(stem: str, views: list[str]) -> tuple[str, str]:
    """Layer and pass, and ".right" if that view is not the first."""
    rest, _, last = stem.rpartition(".")
    if len(views) < 2 or last not in views:
        return stem, ""
    return rest, "" if last == views[0] else f".{last}"


def _views(data: bytes) -> list[str]:
    views, at = [], 0
    while at < len(data):
        size, = struct.unpack_from("<i", data, at)
        views.append(data[at + 4:at + 4 + size].decode())
        at += 4 + size
    return views


def _header(data: memoryview) -> tuple[dict[str, bytes], int]:
    """Texts and what finds the pixels, by name, and where the header ends."""
    magic, version = struct.unpack_from("<2i", data)
    if magic != MAGIC or version & (TILED | MULTIPART):
        raise ValueError("Not an EXR file of one part in scanlines")
    attributes, at = {}, 8
    while data[at]:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        size, = struct.unpack_from("<i", data, at)
        value, at = bytes(data[at + 4:at + 4 + size]), at + 4 + size
        if kind == "string" or name in ("channels", "dataWindow", "multiView"):
            attributes[name] = value
        elif (name, value[0]) in (("compression", NO_COMPRESSION), ("lineOrder", TOP_TO_BOTTOM)):
            continue
        elif name in ("compression", "lineOrder"):
            raise ValueError("A compressed EXR file, or one whose rows begin at the bottom")
    return attributes, at + 1


def _text(data: memoryview, at: int) -> tuple[str, int]:
    end = at
    while data[end]:
        end += 1
    return bytes(data[at:end]).decode(), end + 1


def _channels(data: bytes) -> list[tuple[str, str]]:
    """(name, type of numpy) in the order of the file."""
    channels, at = [], 0
    while data[at]:
        name, at = _text(memoryview(data), at)
        kind, = struct.unpack_from("<i", data, at)
        channels.append((name, PIXEL_TYPES[kind]))
        at += 16
    return channels
