# SPDX-License-Identifier: GPL-3.0-or-later
"""Voronoi Texture: octaves of the distances of voronoi_cells.py."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divide_safely, mix_values
from .node_call import NodeCall
from .noise.fractal import MOST_OCTAVES
from .noise.lattice import in_blocks
from .noise.voronoi_cells import METRICS, Cells, nearest, smooth, sphere_radius, to_edge

FIRST_EDGE = np.float32(8)  # distance to an edge before any octave


def voronoi(n: NodeCall):
    node = n.node
    feature, scale = node.feature, n.get("Scale")
    at = n.coordinates_in(node.voronoi_dimensions) * scale
    detail, roughness, lacunarity, smoothness, exponent, randomness = (
        n.get(name, default)[..., 0] for name, default in (
            ("Detail", 0), ("Roughness", 0.5), ("Lacunarity", 2), ("Smoothness", 1), ("Exponent", 0.5),
            ("Randomness", 1)))
    detail, smoothness = np.clip(detail, 0, MOST_OCTAVES), np.clip(smoothness / 2, 0, 0.5)
    roughness, randomness = np.clip(roughness, 0, 1), np.clip(randomness, 0, 1)
    if feature == "SMOOTH_F1" and not np.any(smoothness):
        feature = "F1"

    def octave(points, randomness, smoothness, exponent):
        cells = Cells(points, randomness, node.distance, exponent, n.conventions.voronoi_uses_pcg)
        if feature == "SMOOTH_F1":
            return smooth(cells, smoothness, n.output.name == "Distance")
        if feature in ("F1", "F2"):
            return nearest(cells, feature == "F2")
        return (to_edge if feature == "DISTANCE_TO_EDGE" else sphere_radius)(cells)[None]

    def at_frequency(frequency):
        return in_blocks(octave, (at * np.asarray(frequency)[..., None]).astype(np.float32), randomness, smoothness,
                         exponent)

    if feature == "N_SPHERE_RADIUS":
        return at_frequency(np.float32(1))[0][..., None]
    farthest = 0.5 + 0.5 * randomness
    if feature != "DISTANCE_TO_EDGE":
        farthest = _diagonal(node, at.shape[-1], farthest, exponent) * (2 if feature == "F2" else 1)
    if not np.any(detail * roughness):
        detail = np.zeros_like(detail)
    sums = _edges if feature == "DISTANCE_TO_EDGE" else _added
    distance, *others = sums(at_frequency, detail, roughness, lacunarity, farthest, node.normalize)
    if n.output.name in ("Distance", "Radius"):
        return distance[..., None]
    color, position = others
    if n.output.name == "Color":
        return color
    position = divide_safely(position, scale)
    if n.output.name == "W":
        return position[..., -1:]
    return np.pad(position, [(0, 0)] * (position.ndim - 1) + [(0, 1)]) if position.shape[-1] == 2 else position[..., :3]


def _diagonal(node, dimensions: int, side: np.ndarray, exponent) -> np.ndarray:
    """How far two points of a cell can lie from each other."""
    offset = np.broadcast_to(side, (dimensions, *np.shape(side)))
    return offset[0] if dimensions == 1 else METRICS[node.distance](offset, exponent)


def _octaves(at_frequency, detail, roughness, lacunarity):
    """The result of each octave, its frequency and amplitude, and its weight."""
    frequency = amplitude = np.float32(1)
    for i in range(int(np.ceil(np.max(detail))) + 1):
        yield at_frequency(frequency), frequency, amplitude, np.clip(detail - i + 1, 0, 1)
        frequency, amplitude = frequency * lacunarity, amplitude * roughness


def _added(at_frequency, detail, roughness, lacunarity, farthest, normalized):
    """Distance, colour and position over all octaves."""
    distance = color = position = weight = np.float32(0)
    for (far, tint, point), frequency, amplitude, share in _octaves(at_frequency, detail, roughness, lacunarity):
        part = share * amplitude
        distance, weight = distance + far * part, weight + part
        color = color + tint * part[..., None]
        position = mix_values(position, point / np.asarray(frequency)[..., None], part[..., None])
    if normalized:
        distance, color = distance / (weight * farthest), color / weight[..., None]
    return distance, color, position


def _edges(at_frequency, detail, roughness, lacunarity, farthest, normalized):
    """Distance over all octaves: each cuts the cells of the one before."""
    distance, most = FIRST_EDGE, farthest
    for (far,), frequency, amplitude, share in _octaves(at_frequency, detail, roughness, lacunarity):
        part = share * amplitude
        most = mix_values(most, farthest / frequency, part)
        distance = mix_values(distance, np.minimum(distance, far / frequency), part)
    return [distance / most if normalized else distance]


FUNCTIONS = {"ShaderNodeTexVoronoi": voronoi}
