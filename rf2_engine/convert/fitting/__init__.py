# SPDX-License-Identifier: GPL-3.0-or-later
"""What depends on the view: box, framing, what is visible, shares of Max Triangles."""
