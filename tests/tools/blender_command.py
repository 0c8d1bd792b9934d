# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's command line, as far as examples/farm uses it, for the bpy wheel, which has none.

    python tests/tools/blender_command.py -b FILE -t THREADS -o OUTPUT -s FIRST -e LAST -a
    python tests/tools/blender_command.py --command renderformer_v2 ARGUMENTS
"""
import argparse
import sys
from pathlib import Path

import bpy

sys.path.append(str(Path(__file__).resolve().parents[2]))

from tools import extension  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--command", nargs=argparse.REMAINDER)
    parser.add_argument("-b", dest="file")
    parser.add_argument("-a", dest="animation", action="store_true", required="-b" in sys.argv)
    parser.add_argument("-o", dest="output")
    for name in ("t", "s", "e"):
        parser.add_argument(f"-{name}", type=int)
    chosen = parser.parse_args()
    extension.load().register()
    if chosen.command:
        from renderformer_v2.rf2_engine.setup import command
        return command.run(chosen.command[1:])
    bpy.ops.wm.open_mainfile(filepath=chosen.file)
    render = bpy.context.scene.render
    if chosen.t:
        render.threads_mode, render.threads = "FIXED", chosen.t
    render.filepath, bpy.context.scene.frame_start, bpy.context.scene.frame_end = chosen.output, chosen.s, chosen.e
    bpy.ops.render.render(animation=True)  # raises where Blender would end with 1
    return 0


if __name__ == "__main__":
    extension.run(main)
