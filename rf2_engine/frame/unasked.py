# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of a view layer that nobody has ticked: Cycles was given them for our own use, and no file needs them.

Cycles fills what the render result has, and Blender has no function that takes a pass out of it. They
are moved into the list of a temporary result, which Blender frees with all that is in it. The main thread does that,
for it reads such lists when it draws.
"""
from __future__ import annotations

import ctypes
from collections.abc import Collection

import bpy

from .. import main_thread
from .. import passes as pass_table

LAYER_BYTES = 336  # of a render layer in Blender 5; the ends of its list of passes are among them
_ADDRESS = ctypes.sizeof(ctypes.c_void_p)


def remove(engine: bpy.types.RenderEngine, layer: str, asked: Collection[str]) -> None:
    """Leave, of the passes that we know, those in `asked` (Blender's names). RenderCancelled ends the waiting."""
    ours = {p.blender_name for p in (*pass_table.PASSES, pass_table.NOISY)} - set(asked)
    if any(p.name in ours for p in engine.get_result().layers[layer].passes):
        main_thread.call(lambda: _remove(engine, layer, ours))


def _remove(engine: bpy.types.RenderEngine, layer: str, names: set[str]) -> None:
    passes = engine.get_result().layers[layer].passes
    chain = [p.as_pointer() for p in passes]
    leaving = [p.as_pointer() for p in passes if p.name in names]
    temporary = engine.begin_result(0, 0, 1, 1, layer=layer)
    try:
        others = [p.as_pointer() for p in temporary.layers[0].passes]
        bases = (_base(engine.get_result().layers[layer], chain), _base(temporary.layers[0], others))
        if all(bases):
            staying = [address for address in chain if address not in leaving]
            _link(bases[0], staying)
            _link(bases[1], others + leaving)
    finally:
        engine.end_result(temporary, cancel=True, do_merge_results=False)


def _base(layer: bpy.types.RenderLayer, chain: list[int]) -> int:
    """Address of the ends of a layer's list of passes; 0 where the list is not kept as we know it."""
    for before, address, after in zip([0, *chain], chain, [*chain[1:], 0]):
        if (_read(address), _read(address + _ADDRESS)) != (after, before):
            return 0
    start = layer.as_pointer()
    places = range(start, start + LAYER_BYTES - _ADDRESS, _ADDRESS)
    return next((at for at in places if (_read(at), _read(at + _ADDRESS)) == (chain[0], chain[-1])), 0)


def _link(base: int, chain: list[int]) -> None:
    """Make these passes the list with ends at `base`."""
    for before, address, after in zip([0, *chain], chain, [*chain[1:], 0]):
        _write(address, after)
        _write(address + _ADDRESS, before)
    _write(base, chain[0])
    _write(base + _ADDRESS, chain[-1])


def _read(address: int) -> int:
    return ctypes.c_void_p.from_address(address).value or 0


def _write(address: int, value: int) -> None:
    ctypes.c_void_p.from_address(address).value = value
