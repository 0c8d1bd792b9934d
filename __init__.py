# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderFormer-V2: a render engine for Blender that turns a scene into a picture with a transformer."""


def register() -> None:
    from .rf2_engine import registration
    registration.register()


def unregister() -> None:
    from .rf2_engine import registration
    registration.unregister()
