# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits of the camera's rays: the buffers of a view (`Guides`), by our own rays or from Cycles' passes."""
