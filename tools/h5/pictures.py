# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of H5 scenes as files."""
from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from tools.common.pictures import write_atomically
from tools.common.tone_mapping import STANDARD, tone_mapped


def save_picture(path: Path, radiance: np.ndarray, mapper: str = STANDARD) -> None:
    """Scene-linear radiance (H, W, 3) as EXR, or tone mapped as PNG, by suffix. Raises OSError naming `path`."""
    write_atomically(path, functools.partial(_save, radiance=radiance, mapper=mapper))


def _save(path: Path, radiance: np.ndarray, mapper: str) -> None:
    if path.suffix.lower() == ".png":
        from skimage.io import imsave
        imsave(path, tone_mapped(radiance, mapper), check_contrast=False)
        return
    import OpenEXR
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(radiance, np.float32)}) as file:
        file.write(str(path))
