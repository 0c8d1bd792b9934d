# SPDX-License-Identifier: GPL-3.0-or-later
"""This add-on as Blender's extensions system knows it: its name, preferences and folders, and access to the network."""
from __future__ import annotations

import os
from pathlib import Path

import bpy

EXTENSION = __package__.rsplit(".", 2)[0]


def preferences() -> bpy.types.AddonPreferences | None:
    """The preferences of the add-on; None where a script enabled it."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon and addon.preferences


def user_folder(name: str = "", create: bool = False) -> Path | None:
    """A folder under Blender's path for this extension; None when run from the source tree, which has no such path."""
    if not EXTENSION.startswith("bl_ext."):
        return None
    return Path(bpy.utils.extension_path_user(EXTENSION, path=name, create=create))


def shared_folder(variable: str) -> Path | None:
    """The folder that a variable of the environment names, absolute, whether it exists or not."""
    text = os.environ.get(variable, "").strip()
    return Path(text).expanduser().absolute() if text else None


def offline() -> str:
    """Why the network may not be used, or "" when the user allowed it."""
    if bpy.app.online_access:
        return ""
    if bpy.app.online_access_override:
        return "Blender was started in offline mode: start it again without --offline-mode"
    return "Allow Online Access in Preferences > System first"
