# SPDX-License-Identifier: GPL-3.0-or-later
"""The journey of one F12, and its steps."""
