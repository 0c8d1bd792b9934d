# SPDX-License-Identifier: GPL-3.0-or-later
"""The additions of the bundled network: guides, light prior, radiosity, decoding of light (docs/architecture.md)."""
