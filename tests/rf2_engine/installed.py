# SPDX-License-Identifier: GPL-3.0-or-later
"""The name of the extension that conftest.py installs. Importing that file by name would install it once more."""

PACKAGE = "bl_ext.user_default.renderformer_v2"
