# SPDX-License-Identifier: GPL-3.0-or-later
"""Training data: random scenes and their Cycles references."""
