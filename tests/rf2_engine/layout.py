# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout without a window, for what panels draw."""
import types

import bpy


class Layout:
    """Takes what a panel draws: property paths that exist, texts, operators that exist."""

    def __init__(self):
        self.shown, self.texts, self.active = set(), [], True
        self.icons = set()  # of labels
        self.operators = []

    def prop(self, data, name, **_):
        assert name in data.bl_rna.properties, f"{data} has no {name}"
        self.shown.add(name)

    def label(self, text="", icon="NONE", **_):
        self.texts.append(text)
        self.icons.add(icon)

    def operator(self, name, **_):
        package, _, operator = name.partition(".")
        assert operator in dir(getattr(bpy.ops, package))
        self.operators.append(types.SimpleNamespace())
        return self.operators[-1]

    def panel(self, _, default_closed=False):
        return self, self  # open

    def __getattr__(self, name):
        return lambda *_, **__: self
