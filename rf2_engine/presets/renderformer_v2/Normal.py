# SPDX-License-Identifier: GPL-3.0-or-later
import bpy

settings = bpy.context.scene.renderformer_v2
settings.token_budget = 4096
settings.max_edge = 0.2
settings.light = "TRACED"
settings.guide_samples = 0
settings.use_adaptive_sampling = True
settings.adaptive_threshold = 0.02
settings.adaptive_min_samples = 24
settings.precision = "auto"
