# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes need few patches."""
import pytest

from renderformer_v2.model.light.bounce import patches


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    """An eighth of the patches of a picture; a module whose tests are about them overrides this with nothing."""
    monkeypatch.setattr(patches, "PATCHES", patches.PATCHES // 8)
