# SPDX-License-Identifier: GPL-3.0-or-later
"""How steady the engine's pictures are from frame to frame."""
