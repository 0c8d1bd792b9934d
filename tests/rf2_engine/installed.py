# SPDX-License-Identifier: GPL-3.0-or-later
"""The name of the extension that conftest.py installs, which must not be imported itself: it would install once more."""

PACKAGE = "bl_ext.user_default.renderformer_v2"
