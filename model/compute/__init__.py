# SPDX-License-Identifier: GPL-3.0-or-later
"""What computes: threads, devices, number formats, memory."""
