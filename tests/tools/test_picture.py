# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture file is whole, or it is not there."""
import numpy as np
import OpenEXR
import pytest
from skimage.io import imsave

from tools.common.pictures import write_whole

PIXELS = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)


def write(path) -> None:
    if path.suffix == ".png":
        return imsave(path, PIXELS)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": PIXELS.astype(np.float32)}) as file:
        file.write(str(path))


@pytest.mark.parametrize("name", ["out.exr", "out.png"])
def test_a_file_that_is_cut_anywhere_does_not_get_the_name(tmp_path, name):
    path = tmp_path / name
    write_whole(path, write)
    whole = path.read_bytes()
    for length in (0, 100, len(whole) // 2, len(whole) - 200):
        with pytest.raises(OSError, match=f"{name} cannot be written: the file came out incomplete"):
            write_whole(path, lambda file, length=length: file.write_bytes(whole[:length]))
        assert path.read_bytes() == whole and list(tmp_path.iterdir()) == [path]
