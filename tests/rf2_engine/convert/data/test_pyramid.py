# SPDX-License-Identifier: GPL-3.0-or-later
"""The levels of an image are means of its colours, whatever way they are computed."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.pictures import srgb_to_linear
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.images import BYTES, _decoded
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.images import Pyramid, area_resample


@pytest.mark.parametrize("size", [(256, 130), (2, 6), (5, 8), (1, 4)])
def test_a_level_has_the_means_of_the_one_before(size):
    texels = np.random.default_rng(1).random((*size, 4), np.float32)
    pyramid = Pyramid(texels)
    rows, columns = (max((side + 1) // 2, 1) for side in size)
    np.testing.assert_allclose(pyramid.level(1), area_resample(texels, rows, columns), atol=1e-6)
    np.testing.assert_allclose(pyramid.level(20)[0, 0], texels.mean((0, 1)), atol=0.1)


@pytest.mark.parametrize("texels", [BYTES[np.random.default_rng(2).integers(0, 256, (40, 50, 4))],
                                    np.random.default_rng(3).random((40, 50, 4), np.float32)], ids=["bytes", "others"])
def test_texels_are_decoded_from_srgb_and_alpha_stays(texels):
    np.testing.assert_array_equal(_decoded(texels), np.concatenate([srgb_to_linear(texels[..., :3]), texels[..., 3:]],
                                                                   axis=-1))
