# SPDX-License-Identifier: GPL-3.0-or-later
"""An animation whose frames hold one picture has the reference in files beside them."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.engine import RenderFormerEngine
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import reference, reference_file
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render


def animate(scene, path, frames=(1, 1), **by_cycles):
    """Render an animation to files that begin with `path`; with samples, by Cycles itself."""
    (scene.frame_start, scene.frame_end), scene.render.filepath = frames, str(path)
    scene.cycles.use_denoising, scene.render.dither_intensity = False, 0  # loaded images are saved without
    if by_cycles:
        scene.render.engine, scene.cycles.samples = "CYCLES", by_cycles["samples"]
    try:
        bpy.ops.render.render(animation=True, scene=scene.name)
    finally:
        scene.render.engine = RenderFormerEngine.bl_idname


def pixels(path) -> np.ndarray:
    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.is_data, image.alpha_mode = True, "CHANNEL_PACKED"
        width, height = image.size
        return np.array(image.pixels[:]).reshape(height, width, -1)
    finally:
        bpy.data.images.remove(image)


@pytest.mark.parametrize("file_format, ending", [("PNG", "png"), ("OPEN_EXR", "exr"), ("JPEG", "jpg")])
def test_the_file_is_what_cycles_saves(lit, tmp_path, file_format, ending):
    compat.set_file_format(lit.render.image_settings, file_format)
    lit.render.film_transparent = file_format != "JPEG"
    lit.view_settings.exposure = 0.5
    animate(lit, tmp_path / "ours_", (1, 2))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"ours_000{frame}{suffix}.{ending}" for frame in (1, 2) for suffix in ("", "_cycles")]
    animate(lit, tmp_path / "theirs_", samples=4)
    beside, cycles = pixels(tmp_path / f"ours_0001_cycles.{ending}"), pixels(tmp_path / f"theirs_0001.{ending}")
    np.testing.assert_array_equal(beside, cycles)
    assert np.ptp(beside) > 0.2 and not np.array_equal(beside, pixels(tmp_path / f"ours_0001.{ending}"))
    assert not any("Cycles Reference" in line for line in last_render.last_frame[0].report)


def test_a_region_is_where_it_is_in_the_frame(lit, tmp_path):
    settings = lit.render
    settings.use_border, settings.border_min_x, settings.border_max_x, settings.border_min_y = True, 0.21, 0.83, 0.3
    animate(lit, tmp_path / "ours_")
    animate(lit, tmp_path / "theirs_", samples=4)
    np.testing.assert_array_equal(pixels(tmp_path / "ours_0001_cycles.png"), pixels(tmp_path / "theirs_0001.png"))


def test_each_view_layer_has_its_own(lit, tmp_path):
    lit.view_layers.new("Other/one")
    animate(lit, tmp_path / "frame")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "frame0001.png", "frame0001_cycles_Other_one.png", "frame0001_cycles_ViewLayer.png"]


def test_what_is_not_to_be_overwritten_stays(lit, tmp_path):
    there = tmp_path / "frame0001_cycles.png"
    there.write_bytes(b"of the user")
    lit.render.use_overwrite = False
    animate(lit, tmp_path / "frame")
    assert there.read_bytes() == b"of the user" and (tmp_path / "frame0001.png").is_file()
    lit.render.use_overwrite = True
    animate(lit, tmp_path / "frame")
    assert there.read_bytes() != b"of the user"


def test_a_name_without_an_ending_and_files_that_hold_it_anyway(lit, tmp_path):
    lit.render.use_file_extension = False
    animate(lit, tmp_path / "frame.v2_")
    assert (tmp_path / "frame.v2_0001_cycles").is_file()
    compat.set_file_format(lit.render.image_settings, "OPEN_EXR_MULTILAYER")
    animate(lit, tmp_path / "multilayer")
    assert not list(tmp_path.glob("multilayer*_cycles*"))


def test_a_file_that_cannot_be_written_is_reported_and_the_frame_is_saved(lit, tmp_path):
    (tmp_path / "frame0001_cycles.png").mkdir()
    animate(lit, tmp_path / "frame")
    assert (tmp_path / "frame0001.png").is_file()
    assert any("cannot be saved beside the frame" in line for line in last_render.last_frame[0].report)


def test_a_movie_says_that_it_does_not_have_the_reference(lit, tmp_path):
    settings = lit.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"
    assert not reference_file.is_written(lit) and reference.is_lost(lit)
    lit.render.resolution_x, lit.render.resolution_y = 64, 48
    animate(lit, tmp_path / "movie")
    assert any(reference.LOST in line for line in last_render.last_frame[0].report)
    assert not list(tmp_path.glob("*_cycles*"))
    if hasattr(lit, "compositing_node_group"):  # which may save it
        lit.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    else:
        lit.use_nodes = True
    assert not reference.is_lost(lit)
