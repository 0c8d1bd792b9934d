# SPDX-License-Identifier: GPL-3.0-or-later
"""The transformer of the paper, and nothing else (docs/network.md)."""
