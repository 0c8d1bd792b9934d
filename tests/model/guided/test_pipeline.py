# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture does not show is not computed."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.renderer import Renderer
from tests.model.samples import floor_view, walls


@pytest.fixture
def lamps_looked_for(monkeypatch):
    """A list with an entry for every search for the lamps that places see."""
    found, real = [], DirectLight.lamps_share

    def spied(self, position, *rest):
        found.append(len(position))
        return real(self, position, *rest)
    monkeypatch.setattr(DirectLight, "lamps_share", spied)
    return found


def test_lamps_at_pixels_only_where_no_light_was_traced(lamps_looked_for):
    view, guides = floor_view()
    traced = replace(guides, traced=np.full(guides.diffuse_color.shape, 0.25, np.float32))
    encoded = Renderer(device="cpu", precision="fp32").encode(walls((0.6, 0.2, 0.2)))

    lamps_looked_for.clear()
    shown = encoded.lobes(view, traced, apart=False).radiance
    assert not lamps_looked_for
    apart = encoded.lobes(view, traced)
    assert lamps_looked_for and apart.direct.any()
    np.testing.assert_array_equal(shown, apart.radiance)

    lamps_looked_for.clear()
    encoded.view(view, guides)
    assert lamps_looked_for
