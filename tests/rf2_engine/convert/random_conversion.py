# SPDX-License-Identifier: GPL-3.0-or-later
"""Many scenes by seed, each converted: no exception, only numbers that are finite, no endless work."""
import faulthandler
import itertools
import os
import sys
import traceback
from dataclasses import fields

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.camera import view_rays
from bl_ext.user_default.renderformer_v2.model.errors import SceneError
from bl_ext.user_default.renderformer_v2.model.normalize import Normalization
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.sketch import Sketch

MOST = 10_000    # reports of progress while one of these tiny scenes is converted
HANGING = 300.0  # seconds after which the process is ended, with the place where it is


def run_seeds(count, build, first=0) -> None:
    """build(rng) changes the open scene, which is then converted; fails with all seeds that went wrong."""
    first += int(os.environ.get("RANDOM_SEED", 0))
    failures = []
    for seed in range(first, first + count):
        faulthandler.dump_traceback_later(HANGING, exit=True, file=sys.__stderr__)
        os.environ["RANDOM_CASE"] = str(seed)  # for whoever looks into a crash
        try:
            with np.errstate(all="ignore"):
                build(np.random.default_rng(seed))
                _convert()
        except Exception as error:
            places = [f"{place.name}:{place.lineno}" for place in traceback.extract_tb(error.__traceback__)[-4:]]
            failures.append(f"seed {seed}: {error!r} in {' > '.join(places)}")
        finally:
            faulthandler.cancel_dump_traceback_later()
    if failures:
        pytest.fail("\n".join([f"{len(failures)} of {count}", *failures]), pytrace=False)


def _convert() -> None:
    depsgraph, reports = bpy.context.evaluated_depsgraph_get(), itertools.count(1)

    def with_an_end(text, fraction):
        assert 0 <= fraction <= 1 and next(reports) <= MOST, text

    try:
        view = convert_camera(depsgraph, 32, 24, None)
    except SceneError:
        view = None
    try:
        with progress.reporting(with_an_end):
            scene = convert(depsgraph, view, ConversionOptions(2000, 0.3), Report())
    except SceneError:
        return
    if view is not None:
        with progress.reporting(with_an_end):
            sketch = Sketch(copy(depsgraph, Report(), reads_images=next(reports) % 2 == 0))
            assert np.isfinite(sketch.picture(*view_rays(view), transparent=True)).all()
    _require_finite(scene)
    _require_finite(Normalization.of(scene).scene(scene))


def _require_finite(group) -> None:
    for f in fields(group):
        value = getattr(group, f.name)
        if isinstance(value, np.ndarray):
            assert np.isfinite(value).all(), f"{f.name} is not finite"
        elif value is not None:
            _require_finite(value)
