# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the paper's architecture, in the published format, draws a room that it has not seen."""
