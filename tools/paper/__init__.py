# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's tables and figures, each by one command."""
