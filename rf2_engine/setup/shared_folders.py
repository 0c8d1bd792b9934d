# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders that many machines or users share instead of one for each, named in the environment."""
from __future__ import annotations

import os
from pathlib import Path

PACKAGES = "RENDERFORMER_V2_PACKAGES"  # Python packages, as Install Packages makes it
WEIGHTS = "RENDERFORMER_V2_WEIGHTS"    # renderformer-v2, or the folder that holds it


def named(variable: str) -> Path | None:
    """The folder that the environment names, absolute, whether it is there or not."""
    text = os.environ.get(variable, "").strip()
    return Path(text).expanduser().absolute() if text else None
