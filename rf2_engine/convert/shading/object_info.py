# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of an instance: Object Info, Particle Info, and attributes that are not the mesh's."""
from __future__ import annotations

import numpy as np

from .node_call import NodeCall
from .noise.hashing import LARGEST, jenkins


def object_info(n: NodeCall):
    place, name = n.placed(), n.output.name
    if name == "Material Index":
        return _values(n.evaluator.material_index)
    return _values({"Location": place.matrix[:3, 3], "Color": place.color[:3], "Alpha": place.color[3],
                    "Object Index": place.index, "Random": place.random}[name])


def particle_info(n: NodeCall):
    particle = n.placed().particle
    if n.output.name == "Random":
        return _values(jenkins(particle.index, 0) / LARGEST)
    return _values(getattr(particle, n.output.name.lower().replace(" ", "_")))


def of_strands(n: NodeCall):
    """Curves Info and Point Info: all 0 on meshes."""
    return np.zeros(3 if n.output.type == "VECTOR" else 1, np.float32)


def property_of(n: NodeCall, name: str, kind: str) -> np.ndarray | None:
    """(4,) a property of the object, of what instances it, or of the view layer."""
    place = n.placed()
    found = {"OBJECT": place.properties, "INSTANCER": place.of_instancer}.get(kind, place.of_view_layer).get(name)
    if found is None:
        return None
    return np.float32({1: (*found * 3, 1), 2: (*found, 0, 1), 3: (*found, 1)}.get(len(found), found))


def _values(of) -> np.ndarray:
    return np.atleast_1d(np.float32(of))


FUNCTIONS = {"ShaderNodeObjectInfo": object_info, "ShaderNodeParticleInfo": particle_info,
             "ShaderNodeHairInfo": of_strands, "ShaderNodePointInfo": of_strands}
