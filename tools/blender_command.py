# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's command line, as far as render managers use it, for the bpy wheel, which has none; the engine is there.

    python -m tools.blender_command -b FILE [-y] [-t THREADS] [-o OUTPUT] [-F FORMAT] -s FIRST -e LAST -a
    python -m tools.blender_command -b FILE [-y] [-t THREADS] [-o OUTPUT] [-F FORMAT] -f 1,3,11..20
    python -m tools.blender_command --command renderformer_v2 install|status [ARGUMENTS]
"""
from __future__ import annotations

import argparse
import signal
import sys

import bpy

from tools import extension
from tools.common.console import whole_number


def frames(text: str) -> list[tuple[int, int]]:
    """A `type` of argparse: "1,3,11..20" as first and last frames. Raises ValueError."""
    ends = [tuple(map(int, part.split(".."))) for part in text.split(",")]
    if any(len(pair) > 2 for pair in ends):
        raise ValueError
    return [(pair[0], pair[-1]) for pair in ends]


def main() -> int:
    parser = argparse.ArgumentParser(prog="blender", description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?")
    parser.add_argument("--command", nargs=argparse.REMAINDER)
    parser.add_argument("-b", "--background", action="store_true", help="as always here: there is no window")
    parser.add_argument("-y", "--enable-autoexec", dest="scripts", action="store_true")
    parser.add_argument("-t", "--threads", type=whole_number(0), default=0)
    parser.add_argument("-o", "--render-output", dest="output")
    parser.add_argument("-F", "--render-format", dest="format")
    parser.add_argument("-s", "--frame-start", dest="first", type=int)
    parser.add_argument("-e", "--frame-end", dest="last", type=int)
    parser.add_argument("-f", "--render-frame", dest="frames", type=frames)
    parser.add_argument("-a", "--render-anim", dest="animation", action="store_true")
    chosen = parser.parse_args()
    if chosen.command is not None and chosen.command[:1] != [extension.PACKAGE]:
        parser.error(f"the only --command here is {extension.PACKAGE}")
    if chosen.command is None and (not chosen.file or chosen.animation == bool(chosen.frames)):
        parser.error("a file, and either an animation (-a) or frames (-f) are needed")
    for number in (signal.SIGINT, signal.SIGTERM):  # Blender would swallow a KeyboardInterrupt
        signal.signal(number, lambda number, _: extension.leave(128 + number))
    extension.load().register()
    if chosen.command:
        from renderformer_v2.rf2_engine.setup import command
        return command.run(chosen.command[1:])
    try:
        bpy.ops.wm.open_mainfile(filepath=chosen.file, use_scripts=chosen.scripts)
        prepare(bpy.context.scene.render, chosen)
        render_frames(bpy.context.scene, chosen)
    except (RuntimeError, ValueError) as error:  # what Blender's operators raise, and a wrong format
        print(str(error).strip(), file=sys.stderr)
        return 1
    return 0


def prepare(render: bpy.types.RenderSettings, chosen: argparse.Namespace) -> None:
    """Raises ValueError for a format that Blender does not know."""
    from renderformer_v2.rf2_engine.compat import set_file_format

    if chosen.threads:
        render.threads_mode, render.threads = "FIXED", chosen.threads
    render.filepath = chosen.output or render.filepath
    if chosen.format and chosen.format != render.image_settings.file_format:
        try:
            set_file_format(render.image_settings, chosen.format)
        except TypeError as error:
            raise ValueError(f"-F {chosen.format}: {error}") from error


def render_frames(scene: bpy.types.Scene, chosen: argparse.Namespace) -> None:
    """Raises RuntimeError for a frame that failed, as Blender would end with 1."""
    first = scene.frame_start if chosen.first is None else chosen.first
    last = scene.frame_end if chosen.last is None else chosen.last
    for scene.frame_start, scene.frame_end in chosen.frames or [(first, last)]:
        bpy.ops.render.render(animation=True)


if __name__ == "__main__":
    extension.run(main)
