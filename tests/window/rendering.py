# SPDX-License-Identifier: GPL-3.0-or-later
"""F12 in the session, and what is seen of it: the stages that begin, the lines that are shown while Cycles runs."""
import sys
from pathlib import Path

import bpy
from driver import F12, Driver, is_rendering

ARCHIVE, FOLDER = map(Path, sys.argv[sys.argv.index("--") + 1:])

driver, stages, lines = Driver(FOLDER), [], []


def watch() -> None:
    """Note the stages that begin, and the lines that are shown while Cycles runs."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress import plan
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status_line import status_line

    def enter(of, stage, real=plan.Plan.enter):
        stages.append(stage.text)
        return real(of, stage)

    def show(text, real=status_line.show):
        lines.append(text)
        real(text)
    plan.Plan.enter, status_line.show = enter, show


def render(editor, shots=False):
    stages.clear()
    driver.key(F12)
    yield is_rendering
    if editor.spaces.active.image is None:
        editor.spaces.active.image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT")
    if shots:
        for stage, name in (("Camera rays", "tracing"), ("Cycles Reference", "reference_runs")):
            yield lambda stage=stage: stage in stages
            yield 1.5
            driver.shot(name)
    yield lambda: not is_rendering()
    yield 1.0
    if shots:
        driver.shot("rendered")
