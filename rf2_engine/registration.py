# SPDX-License-Identifier: GPL-3.0-or-later
"""Register everything in order, and unregister it in reverse order."""
from . import compare, engine, light_group_mixer, material_settings, panels, paper_scenes, reference_settings, settings
from .cycles import world as world_session
from .frame import preflight, shot
from .preferences import package_operators, preferences, weights_operators
from .progress import costs, frame_lines, last_render, status_line
from .registering import modules
from .runtime import model_cache, running
from .setup import command
from .viewport import viewport

MODULES = (running, shot, world_session, costs, last_render, frame_lines, status_line, preflight,
           reference_settings, settings, material_settings, preferences, engine, package_operators, weights_operators,
           light_group_mixer, panels, viewport, compare, paper_scenes, command)
_register_all, _unregister_all = modules(MODULES)


def register() -> None:
    """All of it, or nothing when it raises."""
    if running.cancel_action():
        return  # disabled and enabled again while a render went on: nothing was taken back
    _register_all()


def unregister() -> None:
    """Take everything back once no render of ours is under way: at once as a rule, else when it has ended."""
    if running.stop():
        _take_back()
    else:
        running.when_ended(_take_back)


def _take_back() -> None:
    _unregister_all()
    model_cache.free()
