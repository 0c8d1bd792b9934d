# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps below the plane of a face, but above its shading normal, light it."""
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.compute.threads import Once
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.terminator import CurvedFaces, edge_heights, heights, start_heights
from renderformer_v2.model.light.estimate import SceneLight, estimate_light
from tests.model.samples import floor_scene, floor_view

UP = torch.tensor([[0.0, 0.0, 1.0]])


def bent_floor(lean: float):
    """A floor whose normals lean outwards at its ends, and a lamp just below its plane, on its right."""
    scene = floor_scene(side=1)
    floor = ~scene.is_light
    x = scene.triangles[floor][..., 0]
    normals = np.stack([lean * x, np.zeros_like(x), np.ones_like(x)], -1)
    scene.normals[floor] = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    scene.triangles[scene.is_light] = scene.triangles[scene.is_light] * 0.2 + np.float32((3, 0, -0.6))
    return scene


def test_curved_surfaces_are_parabolas_above_the_edges():
    """Twice as high as an arc, as Cycles has them: its rays start well outside."""
    angle = torch.tensor(0.2)
    ends = [torch.stack([torch.sin(a), torch.zeros(()), torch.cos(a)]) for a in (-angle, angle)]
    normals = torch.stack([*ends, ends[1]])[None]
    corners = torch.stack([ends[0], ends[1], ends[1] + torch.tensor([0.0, 0.1, 0.0])])[None]
    of_edges = edge_heights(corners, normals)
    middle, corner = torch.tensor([[0.5, 0.5, 0.0]]), torch.tensor([[1.0, 0.0, 0.0]])
    assert heights(of_edges, middle).item() == pytest.approx(2 * (1 - torch.cos(angle)).item(), rel=0.02)
    assert heights(of_edges, corner).item() == 0


def test_rays_start_on_the_face_where_light_is_steep_and_on_the_curved_surface_where_it_is_below():
    face, normal = UP, F.normalize(torch.tensor([[1.0, 0.0, 1.0]]), dim=-1)
    directions = F.normalize(torch.tensor([[1.0, 0.0, 1.0], [1.0, 0.0, 0.05], [1.0, 0.0, -0.2]]), dim=-1).T[:, None]
    steep, grazing, below = start_heights(directions, face, normal)[0].tolist()
    assert steep == 0 and 0.3 < grazing < 0.7 and below == 1


def test_a_lamp_below_the_plane_of_a_curved_floor_lights_it_at_pixels_and_patches():
    direct, (view, guides) = DirectLight(bent_floor(2.0)), floor_view()
    right = guides.position[..., 0] > 0.5
    normal = np.stack([2 * guides.position[..., 0], 0 * guides.alpha, np.ones_like(guides.alpha)], -1)
    normal = np.float32(normal / np.linalg.norm(normal, axis=-1, keepdims=True)) * guides.alpha[..., None]
    guides = replace(guides, normal=normal)
    radiosity = Radiosity(bent_floor(2.0), direct)
    lit = estimate_light(SceneLight(bent_floor(2.0), direct, radiosity), view, guides).direct[0, 0].mean(0).numpy()
    unshadowed = direct.diffuse(*(torch.from_numpy(x[right]) for x in (guides.position, normal)),
                                visibility=[torch.ones(int(right.sum()), 3)] * 2).mean().item()
    assert lit[right].mean() > 0.8 * unshadowed > 0
    assert lit[guides.position[..., 0] < -0.5].max() < 1e-3 * unshadowed
    assert radiosity.leaving.max() > 0.3 * unshadowed
    direct._curved = Once((None,))
    dark = estimate_light(SceneLight(bent_floor(2.0), direct, radiosity), view, guides).direct[0, 0].mean(0).numpy()
    assert dark[right].mean() < 0.1 * unshadowed


def test_flat_scenes_have_no_curved_faces():
    assert CurvedFaces.of(floor_scene(), torch.device("cpu")) is None
    assert CurvedFaces.of(bent_floor(2.0), torch.device("cpu")) is not None
