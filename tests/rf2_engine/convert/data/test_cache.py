# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of an edited scene compute again what the edit has changed, and nothing else."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert import compute
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.cache import CopyCache
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.cache import ConversionCache
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes import reduce

from tests.rf2_engine.f12 import cube, sun


@pytest.fixture
def work(scene, monkeypatch):
    """What was computed: simplified meshes by their number of triangles, and worlds."""
    done = []

    def simplify(mesh, *rest, real=reduce.simplify):
        done.append(len(mesh))
        return real(mesh, *rest)

    def world_light(*given, real=compute.convert_world_light, **named):
        done.append("world")
        return real(*given, **named)
    monkeypatch.setattr(reduce, "simplify", simplify)
    monkeypatch.setattr(compute, "convert_world_light", world_light)
    for name, x, levels in (("A", -1.5, 4), ("B", 1.5, 5)):
        cube(scene, name, (x, 0, 0)).modifiers.new("Finer", "SUBSURF").levels = levels
    sun(scene)
    return done


class Conversions:
    """One after the other, of the same view and fitted alike."""

    def __init__(self):
        self.cache, self.kept, self.framing = ConversionCache(), CopyCache(), None

    def convert(self, cache=True):
        depsgraph, report = bpy.context.evaluated_depsgraph_get(), Report()

        def choose_framing(own):
            self.framing = self.framing or own
            return self.framing
        scene = compute.compute(copy(depsgraph, report, cache=self.kept), convert_camera(depsgraph, 50, 37, None),
                                ConversionOptions(512, 1), report, choose_framing=choose_framing,
                                cache=self.cache if cache else None)
        return scene, report.lines()


def test_nothing_is_computed_twice_and_the_result_is_the_same(work):
    conversions = Conversions()
    first, said = conversions.convert()
    assert sorted(map(str, work)) == ["12288", "3072", "world"]
    again, said_again = conversions.convert()
    assert len(work) == 3 and said == said_again
    alone, _ = conversions.convert(cache=False)
    for other in (again, alone):
        np.testing.assert_array_equal(first.triangles, other.triangles)
        np.testing.assert_array_equal(first.environment, other.environment)


def test_only_what_has_moved_is_simplified_again(work):
    conversions = Conversions()
    conversions.convert()
    work.clear()
    bpy.data.objects["B"].location.z = 0.5
    conversions.convert()
    assert work == [12288]


def test_what_a_scene_no_longer_has_is_forgotten(work):
    conversions = Conversions()
    conversions.convert()
    bpy.data.objects.remove(bpy.data.objects["B"])
    conversions.convert()
    assert len(conversions.cache._entries) <= 3
