# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that comes straight from lamps and sky, in closed form, with visibility by rays."""
