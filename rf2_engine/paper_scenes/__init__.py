# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of the research code, in and out; nothing of it is needed to render."""
from .operators import register, unregister

__all__ = ["register", "unregister"]
