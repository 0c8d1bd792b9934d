# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that arrives from emitters and the environment without a bounce: closed forms times visibility by rays."""
