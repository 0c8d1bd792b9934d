# SPDX-License-Identifier: GPL-3.0-or-later
"""Where on patches light is found."""
import numpy as np
import torch

from renderformer_v2.model.light.bounce import patches
from renderformer_v2.model.light.bounce.openness import Openness
from renderformer_v2.model.light.bounce.patch_points import patch_points
from renderformer_v2.model.light.bounce.patches import make_patches
from renderformer_v2.model.light.direct.direct_light import DirectLight
from tests.model.light.bounce.test_patches import patches_of
from tests.model.samples import closed_box, flat, floor_scene, with_black_lamps


def block(side: float) -> np.ndarray:
    """(12, 3, 3) a cube around the origin whose faces look out."""
    square = np.float32([[(-1, -1, 1), (1, -1, 1), (1, 1, 1)], [(-1, -1, 1), (1, 1, 1), (-1, 1, 1)]])
    faces = [np.roll(faces, axis, axis=-1) for axis in range(3) for faces in (square, (square * (1, 1, -1))[:, ::-1])]
    return np.float32(np.concatenate(faces) * side / 2)


def test_points_lie_on_their_patches():
    scene = closed_box((0.5, 0.5, 0.5))
    made = make_patches(scene, DirectLight(scene).emitters.near())
    points, normals, shading, _ = patch_points(made)
    torch.testing.assert_close(shading, normals)  # where there are no others
    assert points.shape == normals.shape == (len(made.center), 3)
    torch.testing.assert_close(points.abs().amax(-1), torch.ones(len(points)), atol=1e-5, rtol=0)
    away = (points - made.center).norm(dim=-1) / made.vector.norm(dim=-1).sqrt()
    assert (away <= 2).all() and (away > 0.1).float().mean() > 0.9
    assert ((normals * made.vector).sum(-1) > 0).all()


def test_what_stands_in_a_floor_hides_no_point_of_patches_that_reach_beyond_it(monkeypatch):
    monkeypatch.setattr(patches, "PATCHES", 256)
    scene = floor_scene(side=1).appended(flat(block(0.7), (0.5, 0.5, 0.5)))
    direct = DirectLight(scene)
    made = make_patches(scene, direct.emitters.near())
    reaches_beyond = (made.corners[..., :2].abs().amax(-1) > 0.36).any(-1)[made.patch.argsort()]  # one triangle each

    def hidden(openness: Openness | None) -> int:
        x = patch_points(made, openness).position
        return int((reaches_beyond & (x[:, 2] == 0) & (x[:, :2].abs().amax(-1) < 0.35)).sum())

    assert len(made.patch) == len(made.center) and hidden(None) > 2
    assert hidden(Openness(scene, direct.occluders, torch.device("cpu"))) == 0


def test_patches_are_shaded_by_the_normals_of_corners_on_the_side_of_their_fronts():
    scene = with_black_lamps(floor_scene())
    scene.normals[:] = (0.6, 0, 0.8)
    _, normals, shading, _ = patch_points(patches_of(scene))
    torch.testing.assert_close(shading * normals[..., 2:], torch.tensor([0.6, 0, 0.8]).expand_as(shading))
    scene = floor_scene()
    scene.normals[:] = (1, 0, -0.1)  # below the surface, from where no light can come
    _, normals, shading, _ = patch_points(patches_of(scene))
    assert ((shading * normals).sum(-1) > 0.1).all()
