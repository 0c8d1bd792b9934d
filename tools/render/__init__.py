# SPDX-License-Identifier: GPL-3.0-or-later
"""Render one .blend file or H5 scene from the command line."""
