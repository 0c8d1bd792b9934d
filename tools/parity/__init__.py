# SPDX-License-Identifier: GPL-3.0-or-later
"""The network against golden numbers of the reference implementation."""
