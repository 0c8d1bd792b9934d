# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader node graphs evaluated to arrays: one short function per node."""
