# SPDX-License-Identifier: GPL-3.0-or-later
"""Command lines over the two packages.

They import the add-on as the package `renderformer_v2`, as Blender does under another name, so that every class of it
exists once in a process. PyTorch is imported after them, so what has to be set before that is set here.
"""
from .extension import load

load()

from renderformer_v2.model.compute import process  # noqa: E402

process.prepare()
