# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a render, and its statistics afterwards."""
