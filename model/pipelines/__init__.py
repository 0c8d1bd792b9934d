# SPDX-License-Identifier: GPL-3.0-or-later
"""The two ways from a normalised scene to a picture: guided (bundled preset) and published (the paper's weights).

A pipeline has
    variant(view)                      which of its networks renders that view; part of the key of a kept scene
    encode(scene, variant, progress)   stage 1; the result has `.context` (SceneContext)
    image(encoded, view, guides, progress)  (3, H, W) f32 radiance in network exposure, without emitters seen directly
where scene, view and guides are normalised and the view's sides are multiples of 64.
"""
