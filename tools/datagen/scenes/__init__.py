# SPDX-License-Identifier: GPL-3.0-or-later
"""The generator of random scenes: `generator.build_scene` makes one per seed, the other modules its parts."""
