# SPDX-License-Identifier: GPL-3.0-or-later
"""One F12: render.py calls the steps in order."""
