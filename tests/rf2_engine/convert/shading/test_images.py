# SPDX-License-Identifier: GPL-3.0-or-later
"""Image textures against Cycles: files of every kind, alpha, colour space, projection, extension, interpolation."""
import bpy
import numpy as np
import pytest

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene
from tests.rf2_engine.convert.shading.kinds import of_color
from tests.rf2_engine.convert.shading.squares import Case
from tests.rf2_engine.convert.shading.test_against_cycles import assert_alike

SMALL = 6  # pixels, which are interpolated


def texels(seed, side, alpha=False):
    found = np.random.default_rng(seed).uniform(0.05, 0.95, (side, side, 4)).astype(np.float32)
    found[..., 3] = found[..., 3] if alpha else 1
    return found


def written(path, pixels, kind="PNG"):
    """The path of a picture file with these stored pixels."""
    image = bpy.data.images.new("Written", pixels.shape[1], pixels.shape[0], alpha=True,
                                float_buffer=kind == "OPEN_EXR")
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(path), kind
    image.save()
    bpy.data.images.remove(image)
    return str(path)


def shown(open_image, output="Color", mixed=False, vector=None, **settings):
    """A case of an Image Texture of what `open_image()` gives, at UVs from -1 to 1 if nothing else is asked for."""
    def prepare(node):
        node.image = open_image()
        for key, value in settings.items():
            owner, _, name = key.rpartition("__")
            setattr(getattr(node, owner) if owner else node, name, value)
        if mixed:  # alpha is asked for as well, so that colours come straight
            tree, one = node.id_data, node.id_data.nodes.new("ShaderNodeMath")
            one.operation, one.inputs[1].default_value, one.inputs[2].default_value = "MULTIPLY_ADD", 0, 1
            tree.links.new(node.outputs["Alpha"], one.inputs[0])
            tree.links.new(one.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    return Case("ShaderNodeTexImage", {"Vector": vector or "at"}, {}, output, prepare)


def opened(path, space="Non-Color", alpha_mode="STRAIGHT", source="FILE"):
    def open_image():
        image = bpy.data.images.load(path)
        image.source, image.colorspace_settings.name, image.alpha_mode = source, space, alpha_mode
        return image
    return open_image


def generated(seed, side, space="Non-Color", is_float=False):
    def make():
        image = bpy.data.images.new("Made", side, side, alpha=True, float_buffer=is_float)
        image.colorspace_settings.name = space
        image.pixels.foreach_set(texels(seed, side).ravel())
        return image
    return make


@pytest.fixture(autouse=True)
def empty():
    empty_cycles_scene()


def packed(path):
    def open_image():
        image = opened(path)()
        image.pack()
        return image
    return open_image


def tiled(folder, pack=False):
    for number in (1001, 1002, 1011):
        written(folder / f"tile.{number}.png", texels(number, SMALL))

    def open_image():
        image = bpy.data.images.load(str(folder / "tile.1001.png"))
        image.source, image.filepath = "TILED", str(folder / "tile.<UDIM>.png")
        for number in (1002, 1011):
            image.tiles.new(tile_number=number)
        image.colorspace_settings.name = "Non-Color"
        if pack:
            image.pack()
        return image
    return open_image


def test_files_of_every_kind_are_as_in_cycles(tmp_path):
    picture = written(tmp_path / "picture.png", texels(1, SMALL, alpha=True))
    loose = texels(1, SMALL, alpha=True)
    loose[..., :3] *= loose[..., 3:]
    premultiplied = written(tmp_path / "premultiplied.png", loose)
    high = written(tmp_path / "high.exr", texels(2, SMALL) * np.float32((3, 3, 3, 1)), "OPEN_EXR")
    odd = texels(5, SMALL)
    odd[1, 2, 0], odd[3, 3, 1] = np.inf, np.nan
    numberless = written(tmp_path / "numberless.exr", odd, "OPEN_EXR")
    cases = [
        shown(opened(numberless), interpolation="Closest"), shown(opened(numberless, "Linear Rec.709")),
        *(shown(opened(picture), extension=extension, interpolation=interpolation)
          for extension in ("REPEAT", "EXTEND", "CLIP", "MIRROR")
          for interpolation in ("Linear", "Closest", "Cubic", "Smart")),
        *(shown(opened(premultiplied if mode == "PREMUL" else picture, space, mode), output, mixed)
          for space in ("Non-Color", "sRGB", "Linear Rec.709")
          for mode in ("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE")
          for output, mixed in (("Color", False), ("Color", True), ("Alpha", False))),
        *(shown(opened(high, space)) for space in ("Linear Rec.709", "ACEScg", "Linear Rec.2020", "Non-Color")),
        shown(packed(picture)), shown(generated(3, SMALL)), shown(generated(3, SMALL, is_float=True)),
        *(shown(generated(4, SMALL, space)) for space in ("sRGB", "Linear Rec.709", "ACEScg", "Display P3",
                                                          "Filmic sRGB", "Rec.1886")),
    ]
    assert_alike(cases, most=0.03)  # Cycles multiplies bytes with alpha, and rounds


def test_tiles_and_sequences_are_as_in_cycles(tmp_path):
    for frame in range(1, 5):
        written(tmp_path / f"still_{frame:03}.png", texels(frame, SMALL))
    first = opened(str(tmp_path / "still_001.png"), source="SEQUENCE")

    def of_frame_three(**settings):
        case = shown(first, **{f"image_user__{key}": value for key, value in settings.items()})
        case.furnish = lambda square: bpy.context.scene.frame_set(3)
        return case

    cases = [
        *(shown(tiled(tmp_path, pack), output, vector="wide", interpolation=kind) for pack in (False, True)
          for output, kind in (("Color", "Linear"), ("Color", "Closest"))),
        *(of_frame_three(frame_start=start, frame_duration=count, frame_offset=offset, use_cyclic=cyclic)
          for start, count, offset, cyclic in ((1, 4, 0, False), (1, 2, 0, False), (1, 2, 0, True), (2, 4, 1, False),
                                               (4, 3, 1, False), (4, 3, 1, True)))]
    assert_alike(cases)


@pytest.mark.skipif(not hasattr(bpy.data, "colorspace"), reason="Blender 4 has one working space")
def test_colours_are_right_in_another_working_space():
    def in_acescg(case):
        before = case.prepare

        def prepare(node):
            if bpy.data.colorspace.working_space != "ACEScg":
                bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
            before(node)
        case.prepare = prepare
        return case

    assert_alike([in_acescg(case) for case in (
        *(shown(generated(4, SMALL, space)) for space in ("sRGB", "Linear Rec.709", "ACEScg", "Non-Color")),
        of_color("RGBToBW"), Case("ShaderNodeMath", {0: "color", 1: 0.5}, {"operation": "MULTIPLY"}),
        *(Case("ShaderNodeBlackbody", {"Temperature": kelvin}) for kelvin in (2000.0, 8000.0)))], most=0.015)


def test_projections_are_as_in_cycles():
    def bent(square):
        corners = [(1, 0.2, 0.1), (0.3, -1, 0.2), (-0.4, 0.2, 1), (-1, 0.8, -0.1)]
        square.data.normals_split_custom_set([corners[v] for v in (0, 1, 3, 1, 2, 3)])

    cases = [shown(generated(3, SMALL), projection=kind) for kind in ("SPHERE", "TUBE")]
    for blend in (0.0, 0.3, 1.0):
        case = shown(generated(3, SMALL), projection="BOX", projection_blend=blend)
        case.furnish, case.is_affine = bent, False
        cases.append(case)
    assert_alike(cases)
