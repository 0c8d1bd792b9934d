# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that arrives straight from lamps and sky, in closed form, with what stands in its way."""
