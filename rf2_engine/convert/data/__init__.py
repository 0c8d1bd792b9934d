# SPDX-License-Identifier: GPL-3.0-or-later
"""What is copied from a scene, and reports: plain objects and arrays that every other folder knows."""
