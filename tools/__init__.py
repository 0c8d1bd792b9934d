# SPDX-License-Identifier: GPL-3.0-or-later
"""Command lines over the two packages.

They import the add-on as the package `renderformer_v2`, as Blender does under another name, so that every class of it
exists once in a process.
"""
from .extension import load

load()
