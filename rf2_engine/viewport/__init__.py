# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered viewports: the scene as the network alone shows it, while it is edited."""
