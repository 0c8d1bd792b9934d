# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera Properties: our settings, below those of Blender and Cycles."""
from __future__ import annotations

from ...model.panorama import PROJECTIONS
from ..registering import appended
from ..setup.display import draw_text
from .panel import EnginePanel

# Settings that Blender shows for Cycles only: in groups, with labels where their own names are too long.
PANORAMA_SETTINGS = {
    "EQUIRECTANGULAR": ({"latitude_min": "Latitude", "latitude_max": "To"},
                        {"longitude_min": "Longitude", "longitude_max": "To"}),
    "CENTRAL_CYLINDRICAL": (
        {"central_cylindrical_range_v_min": "Height", "central_cylindrical_range_v_max": "To"},
        {"central_cylindrical_range_u_min": "Longitude", "central_cylindrical_range_u_max": "To"},
        {"central_cylindrical_radius": "Radius"}),
    "FISHEYE_EQUIDISTANT": ({"fisheye_fov": None},),
    "FISHEYE_EQUISOLID": ({"fisheye_lens": "Lens"}, {"fisheye_fov": None}),
    "FISHEYE_LENS_POLYNOMIAL": ({"fisheye_fov": None},
                                {f"fisheye_polynomial_k{power}": f"K{power}" for power in range(5)}),
}


def draw_lens(self, context) -> None:
    """Draw the panorama below Blender's own settings of the lens."""
    if not EnginePanel.poll(context):
        return
    camera = context.camera
    if camera.type == "PANO":
        _draw_panorama(self.layout, camera)
    elif camera.type not in {"PERSP", "ORTHO"}:
        draw_text(self.layout, "This camera type is not supported: choose Perspective, Orthographic or Panoramic")


def _draw_panorama(layout, camera) -> None:
    layout.use_property_split = True
    layout.prop(camera, "panorama_type", text="Panorama")
    for group in PANORAMA_SETTINGS.get(camera.panorama_type, ()):
        column = layout.column(align=True)
        for name, label in group.items():
            column.prop(camera, name, text=label)
    if camera.panorama_type not in PROJECTIONS:
        draw_text(layout, "This panorama type is not supported: choose another one")


def draw_lens_samples(self, context) -> None:
    """Draw the number of samples, a setting of the scene, below Cycles' own settings of the focus."""
    layout = self.layout
    if context.camera.type == "PANO":
        draw_text(layout, "A panoramic camera has no depth of field with this engine", icon="INFO")
        return
    layout.prop(context.scene.renderformer_v2, "lens_samples", text="Samples")
    if context.camera.dof.use_dof and context.scene.renderformer_v2.lens_samples == 1:
        draw_text(layout, "Everything is in focus: set Samples above 1 for blur", icon="INFO")


register, unregister = appended("DATA_PT_lens", draw_lens)
