# SPDX-License-Identifier: GPL-3.0-or-later
"""Command lines over the two packages."""
