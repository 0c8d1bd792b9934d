# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera, and what it sees of a scene."""
