# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors whose message is written for the user; everything else that is raised is a bug."""


class RenderCancelled(Exception):
    """The user pressed Esc; raised out of a progress callback."""


class CheckpointError(Exception):
    """A weights file or folder cannot be used; the message says which and what to do."""


class SceneError(Exception):
    """The scene cannot be rendered at all; the message names the object and what to do."""
