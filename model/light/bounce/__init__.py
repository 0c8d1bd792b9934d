# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has bounced between surfaces."""
