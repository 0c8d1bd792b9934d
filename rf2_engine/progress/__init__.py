# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user is told while a frame renders, and afterwards."""
