# SPDX-License-Identifier: GPL-3.0-or-later
"""What several commands share: arguments, output, picture files, metrics, and .blend files."""
