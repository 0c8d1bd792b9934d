# SPDX-License-Identifier: GPL-3.0-or-later
"""The projection of a panoramic camera, as in Cycles."""
from __future__ import annotations

import bpy

from ....model.errors import SceneError
from ....model.panorama import PROJECTIONS, Panorama


def read_panorama(camera: bpy.types.Object, shift_x: float, width: int, height: int,
                  settings: bpy.types.RenderSettings) -> Panorama:
    """A Panorama of `width` x `height` pixels. Raises SceneError for unknown projections and ones without pixels."""
    data = camera.data
    if data.panorama_type not in PROJECTIONS:
        name = data.bl_rna.properties["panorama_type"].enum_items[data.panorama_type].name
        raise SceneError(f'Camera "{camera.name}" has the Panorama Type {name}, which is not supported: choose another '
                         "one in Camera Properties > Lens")
    panorama = Panorama(data.panorama_type, width, height, _numbers(data, width, height, settings),
                        (shift_x, data.shift_y))
    if not panorama.shows_something:
        raise SceneError(f'Camera "{camera.name}" sees nothing: look at its angles in Camera Properties > Lens')
    return panorama


def _numbers(data: bpy.types.Camera, width: int, height: int, settings: bpy.types.RenderSettings) -> tuple[float, ...]:
    if data.panorama_type == "EQUIRECTANGULAR":
        return data.longitude_min, data.longitude_max, data.latitude_min, data.latitude_max
    if data.panorama_type == "CENTRAL_CYLINDRICAL":
        low = data.central_cylindrical_range_v_min / data.central_cylindrical_radius
        high = data.central_cylindrical_range_v_max / data.central_cylindrical_radius
        return data.central_cylindrical_range_u_min, data.central_cylindrical_range_u_max, low, high
    if data.panorama_type == "FISHEYE_EQUIDISTANT":
        return (data.fisheye_fov,)
    if data.panorama_type == "FISHEYE_EQUISOLID":
        return data.fisheye_lens, data.fisheye_fov, *_sensor(data, width, height, settings)
    if data.panorama_type == "FISHEYE_LENS_POLYNOMIAL":
        coefficients = (getattr(data, f"fisheye_polynomial_k{power}") for power in range(5))
        return data.fisheye_fov, *_sensor(data, width, height, settings), *coefficients
    return ()


def _sensor(data: bpy.types.Camera, width: int, height: int,
            settings: bpy.types.RenderSettings) -> tuple[float, float]:
    """Width and height in mm of the part of the sensor that the picture covers."""
    wide, tall = width * settings.pixel_aspect_x, height * settings.pixel_aspect_y
    if data.sensor_fit == "VERTICAL":
        return data.sensor_height * wide / tall, data.sensor_height
    if data.sensor_fit == "HORIZONTAL" or wide >= tall:
        return data.sensor_width, data.sensor_width * tall / wide
    return data.sensor_width * wide / tall, data.sensor_width
