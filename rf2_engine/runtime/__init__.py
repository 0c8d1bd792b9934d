# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames and viewports share and what outlives a frame: running renders, loaded network, viewport thread."""
