# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewports without a window: a real depsgraph, and the numbers that a region would have."""
import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.pictures import ViewportSettings
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.region_view import RegionView
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Request, Session
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.source import Source


def depsgraph():
    return bpy.context.evaluated_depsgraph_get()


def frozen(matrix):
    return tuple(map(tuple, np.array(matrix).tolist()))


def through_camera(scene, width, height, rectangle=None):
    """The RegionView of a region that the camera's picture fills."""
    camera = scene.camera.evaluated_get(depsgraph())
    projection = camera.calc_matrix_camera(depsgraph(), x=width, y=height)
    return RegionView(frozen(projection), frozen(camera.matrix_world), rectangle or (0, width, 0, height),
                      (width, height))


def read(source=None, hides=None):
    """A source that is up to date."""
    source = source or Source()
    while not source.refresh(depsgraph(), hides):
        pass
    return source


def request(scene, source, view):
    """Of all levels, however busy the machine is."""
    scene.renderformer_v2.viewport.time_limit = 0
    return Request(source.copied, source.state, view, ViewportSettings.read(scene, depsgraph().view_layer))


def pictures(session):
    """What a session shows one after the other until it is done, and which pieces of work had nothing to show."""
    found = []
    while session.has_work():
        before = session.displayed
        session.step(lambda *_: None)
        found.append(session.displayed if session.displayed is not before else None)
    assert not session.error, session.error
    return found


def finished(scene, view, source=None):
    """The last picture of a view."""
    session = Session()
    session.submit(request(scene, source or read(), view))
    return pictures(session)[-1]
