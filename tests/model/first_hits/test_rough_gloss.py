# SPDX-License-Identifier: GPL-3.0-or-later
"""Of gloss whose facets do not light each other a part gets out, of other gloss and of coats all."""
import numpy as np

from renderformer_v2.model.first_hits import rough_gloss
from renderformer_v2.model.scene import ROUGHNESS
from tests.model.samples import floor_scene, floor_view

MEASURED = 0.40  # of light from everywhere, at right angles and a roughness of 1, in Cycles


def test_rough_gloss_is_darker_where_facets_scatter_light_once():
    scene, (view, guides) = floor_scene(), floor_view(16, 16)
    scene.tiles[:, ROUGHNESS] = 1
    assert rough_gloss.with_kept(guides, scene, view) is guides
    scene.single = np.ones(len(scene.tiles), np.float32)
    hit = guides.hit_triangle >= 0
    share = rough_gloss.with_kept(guides, scene, view).glossy_kept[hit]
    assert hit.any() and abs(share.max() - MEASURED) < 0.15 and share.min() > 0.3
    scene.coat = np.float32([(1, 0.04, 0.1, 0.5)])  # half of the gloss
    coated = rough_gloss.with_kept(guides, scene, view).glossy_kept[hit]
    np.testing.assert_allclose(1 - coated, (1 - share) / 2, rtol=1e-4)
    scene.tiles[:, ROUGHNESS], scene.coat = 0.1, None
    np.testing.assert_allclose(rough_gloss.with_kept(guides, scene, view).glossy_kept[hit], 1, rtol=0.02)
