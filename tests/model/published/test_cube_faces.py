# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramas are made of pinhole pictures without seams."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.camera import view_rays
from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.geometry import rotation_matrix
from renderformer_v2.model.panorama import Panorama
from renderformer_v2.model.published.cube_faces import cube_faces, join_faces
from renderformer_v2.model.published.processed_scene import square_fov
from renderformer_v2.model.scene import View

WHOLE = "EQUIRECTANGULAR", (-np.pi, np.pi, -np.pi / 2, np.pi / 2)


def view_of(kind, numbers, width=256, height=128, mirror=1):
    panorama = Panorama(kind, width, height, numbers, (0.0, 0.0))
    pose, fine = np.eye(4), panorama.pixels_per_radian
    pose[:3, :3], pose[:3, 3] = rotation_matrix(np.array([0.7, -0.4, 1.1])), (1, 2, 3)
    return View(pose.astype(np.float32), np.float32([mirror * fine, fine]), np.float32([width, height]) / 2, width,
                height, round(2 * fine), panorama=panorama)


def painted(rays):
    """(..., 3) colours that change with the direction."""
    return 0.5 + 0.5 * np.sin(3 * rays + np.arange(3))


def of_faces(view, paint):
    """The panorama (H, W, 3) of faces that `paint` made of their views, and these views."""
    rendered = []

    def render(face):
        rendered.append(face)
        return torch.from_numpy(np.float32(paint(face))).movedim(-1, 0)
    return join_faces(view, cube_faces(view, 64), render).movedim(0, -1).numpy(), rendered


@pytest.mark.parametrize("kind, numbers", [WHOLE, ("MIRRORBALL", ()), ("FISHEYE_EQUIDISTANT", (6.0,)),
                                           ("CENTRAL_CYLINDRICAL", (-3.0, 3.0, -1.0, 2.0))])
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_panorama_shows_what_its_faces_show(kind, numbers, mirror):
    view = view_of(kind, numbers, mirror=mirror)
    found, faces = of_faces(view, lambda face: painted(view_rays(face)[1]))
    assert all(face.width == face.height and not face.width % 64 for face in faces)
    np.testing.assert_allclose(found, painted(view_rays(view)[1]), atol=5e-3)


def test_faces_that_differ_leave_no_edge():
    view, number = view_of(*WHOLE, 512, 256), iter(range(6))
    found, faces = of_faces(view, lambda face: np.full((face.height, face.width, 3), next(number)))
    assert len(faces) == 6 and {round(float(x), 3) for x in (found.min(), found.max())} == {0, 5}
    middle = found[64:192, :, 0]  # where a pixel is no narrower than two thirds of one on the horizon
    assert np.abs(np.diff(middle, axis=1)).max() < 5 / 4  # between 0 and 5 there are a few steps


def test_only_faces_that_are_seen_are_rendered():
    assert len(of_faces(view_of("FISHEYE_EQUIDISTANT", (0.9,), 64, 64), lambda face: view_rays(face)[1])[1]) == 1
    assert len(of_faces(view_of("EQUIANGULAR_CUBEMAP_FACE", (), 64, 64), lambda face: view_rays(face)[1])[1]) == 5


def test_a_panorama_cannot_be_exported():
    with pytest.raises(SceneError, match="panoramas"):
        square_fov(view_of(*WHOLE))
