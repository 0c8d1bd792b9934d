# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera: projection, lens and eyes."""
