# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of the guided network, of the published ones and of materials."""
