# SPDX-License-Identifier: GPL-3.0-or-later
"""Setup: Python packages, published weights, preferences."""
