# SPDX-License-Identifier: GPL-3.0-or-later
"""What mirrors and glass show, by paths through the token triangles."""
