# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences: packages and weights, with the buttons that install, download and remove them."""
