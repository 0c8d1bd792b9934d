# SPDX-License-Identifier: GPL-3.0-or-later
"""What the bundled preset adds to the network: guides, light prior, decoding of light (docs/architecture.md)."""
