# SPDX-License-Identifier: GPL-3.0-or-later
"""What the light tokens and the panorama of a converted scene say, integrated, to compare with cycles_reference.py."""
import numpy as np

from bl_ext.user_default.renderformer_v2.model.beams import beam_share
from bl_ext.user_default.renderformer_v2.model.geometry import latlong_directions


def integrated(scene, point, normal, cuts=12):
    """(3,) unshadowed irradiance: sum over cut triangles of L beam cos cos / d^2 dA, both cosines one-sided."""
    i, j = np.meshgrid(np.arange(cuts), np.arange(cuts), indexing="ij")
    upright, turned = i + j < cuts, i + j < cuts - 1
    middle = np.concatenate([np.stack([i, j], -1)[upright] + 1 / 3, np.stack([i, j], -1)[turned] + 2 / 3]) / cuts
    weights = np.concatenate([middle, 1 - middle.sum(axis=1, keepdims=True)], axis=1)
    corners = scene.triangles.astype(np.float64)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None] / 2 / len(weights)
    away = np.asarray(point) - np.einsum("gk,nkd->ngd", weights, corners)
    distance = np.linalg.norm(away, axis=-1, keepdims=True)
    away = away / distance
    emitted = np.maximum((away * area).sum(axis=-1), 0)
    received = np.maximum(-away @ (np.asarray(normal) / np.linalg.norm(normal)), 0)
    share = beam_share((away * scene.beam_axis[:, None]).sum(axis=-1), scene.beam_cosine[:, None])
    beam = np.where(scene.beam_axis.any(axis=1)[:, None], share, 1)
    return (emitted * received * beam / distance[..., 0] ** 2).sum(axis=1) @ scene.emission


def gathered(environment, normal):
    """(3,) irradiance of a facet in the open: the map summed over the hemisphere of its normal."""
    theta = np.pi * (np.arange(256) + 0.5) / 256
    solid_angle = np.sin(theta) * (np.pi / 256) * (2 * np.pi / 512)
    cosine = np.maximum(latlong_directions(np.arange(256), 256, 512) @ (np.asarray(normal) / np.linalg.norm(normal)), 0)
    return np.einsum("rwk,rw,r->k", environment.astype(np.float64), cosine, solid_angle)
