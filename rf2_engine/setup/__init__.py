# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sets up once: Python packages, published weights, preferences."""
