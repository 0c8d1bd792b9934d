# SPDX-License-Identifier: GPL-3.0-or-later
"""H5 scenes of the authors' code, many at once: rendered as their command line does, and converted."""
