# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on disabled while it renders: in a process of its own, which crashed when the engine's class went at once."""
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PROGRAM = """
import os, sys, threading
import tools, bpy
from tools import extension
from tools.benchmark import ring

package = extension.load()
package.register()
ring.build(ring.LEAST, 64)
scene = bpy.context.scene
scene.render.engine, scene.renderformer_v2.max_edge = "RENDERFORMER_V2", 1
scene.frame_start, scene.frame_end, scene.render.filepath = 1, 3, sys.argv[2]
scene.render.use_persistent_data = "persistent" in sys.argv
frames, disabling = [], []
bpy.app.handlers.render_pre.append(lambda *_: frames.append(scene.frame_current))

def disable(*_):
    if not disabling:
        disabling.append(threading.Thread(target=package.unregister))
        if "thread" in sys.argv:
            disabling[0].start()
            disabling[0].join(0.3)
        else:
            package.unregister()

def disable_in_stage(status):
    if status._displayed[0] == "Network":
        disable()
    return False

def renders(animation="animation" in sys.argv):
    try:
        bpy.ops.render.render(animation=animation)
    except RuntimeError as error:
        print(error)

from renderformer_v2.rf2_engine.progress.status import Status
from renderformer_v2.rf2_engine.progress.last_render import last_frame
if sys.argv[1] == "unbegun":
    scene.render.use_border, scene.render.border_max_x = True, 0
    for scene.render.engine in sys.argv[3:]:
        renders(True)
    scene.render.use_border, scene.render.engine = False, "RENDERFORMER_V2"
    renders()
    print("rendered", [bool(layer.device) for layer in last_frame])
    scene.render.use_border = True
    renders(True)
    package.unregister()
    print(f"settings {hasattr(bpy.types.Scene, 'renderformer_v2')}")
    sys.stdout.flush()
    os._exit(0)
if sys.argv[1] == "before":
    bpy.app.handlers.render_pre.append(disable)
else:
    Status.esc_pressed = disable_in_stage
renders()
if "thread" in sys.argv:
    disabling[0].join()
print(f"frames {len(frames)}, settings {hasattr(bpy.types.Scene, 'renderformer_v2')}, {scene.render.engine}")
bpy.app.handlers.render_pre.clear()
Status.esc_pressed = lambda status: False
package.register()
scene.render.engine = "RENDERFORMER_V2"
renders()
print("again", [bool(layer.device) for layer in last_frame])
sys.stdout.flush()
os._exit(0)
"""


def run_program(*arguments: str) -> str:
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], cwd=ROOT, capture_output=True, text=True,
                          timeout=600)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("arguments", [("before",), ("within",), ("within", "animation"),
                                       *(pytest.param(way, marks=pytest.mark.slow) for way in (
                                           ("within", "thread"), ("within", "persistent", "animation"),
                                           ("within", "persistent", "thread")))],
                         ids=" ".join)
def test_disabling_while_it_renders_cancels_and_then_takes_everything_back(tmp_path, arguments):
    stage, *others = arguments
    output = run_program(stage, str(tmp_path / "frame_"), *others)
    assert "disabled while it rendered" in output
    assert "frames 1, settings False" in output
    if "animation" not in others:
        assert "again [True]" in output


@pytest.mark.parametrize("engines", [pytest.param(("RENDERFORMER_V2",), marks=pytest.mark.slow),
                                     ("RENDERFORMER_V2", "CYCLES")], ids=" ".join)
def test_an_animation_that_fails_before_its_first_frame_is_no_render_under_way(tmp_path, engines):
    output = run_program("unbegun", str(tmp_path / "frame_"), *engines)
    assert "Image too small" in output
    assert "rendered [True]" in output
    assert "settings False" in output
