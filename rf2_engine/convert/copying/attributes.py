# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes that materials read by name: of the mesh, its object, its instancer and the view layer."""
from __future__ import annotations

import numpy as np

from ....model import progress
from ..data.mesh import PIECE
from ..shading.coordinates import PER_ISLAND
from ..shading.input_nodes import INFO
from ..shading.noise.hashing import LARGEST, jenkins

STORED = {  # how Cycles knows an attribute: where its numbers are, and how many
    "FLOAT": ("value", 1), "INT": ("value", 1), "INT8": ("value", 1), "BOOLEAN": ("value", 1), "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3), "FLOAT_COLOR": ("color", 4), "BYTE_COLOR": ("color", 4), "QUATERNION": ("value", 4)}
MESH, OBJECT, INSTANCER, VIEW_LAYER = "GEOMETRY", "OBJECT", "INSTANCER", "VIEW_LAYER"
CLOSE = 1e-4         # of matrices of one instance
UNUSED = 2 ** 31 - 1  # end of a persistent_id


def _rounded(mean: np.ndarray) -> np.ndarray:
    return np.trunc(mean + np.copysign(0.5, mean))


EDGES = {"BOOLEAN": np.ceil, "INT": _rounded, "INT8": _rounded}  # what becomes of their mean at a vertex


class RequestedAttributes:
    """The names in all Attribute nodes, by kind, and their values of the rendered view layer."""

    def __init__(self, depsgraph):
        self.names: dict[str, set[str]] = {kind: set() for kind in (MESH, OBJECT, INSTANCER, VIEW_LAYER)}
        for tree in (data for data in depsgraph.ids if data.id_type == "NODETREE"):
            for node in tree.nodes:
                if node.bl_idname == "ShaderNodeAttribute":
                    self.names[node.attribute_type].add(node.attribute_name)
                elif node.bl_idname in INFO:
                    self.names[MESH].update(INFO[node.bl_idname] + output.name
                                            for output in node.outputs if output.is_linked)
        scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        self.view_layer_properties = _first(self.names[VIEW_LAYER], layer, scene, scene.world)
        self.instances: dict[int, _Instances] = {}  # by pointer of the instancer

    def read_object(self, obj) -> dict[str, tuple]:
        return _first(self.names[OBJECT], obj, obj.data)

    def read_instancer(self, instance) -> dict[str, tuple]:
        """Values for a DepsgraphObjectInstance, from itself, its particles, the instancer or its own object."""
        if not self.names[INSTANCER]:
            return {}
        system = instance.particle_system if instance.is_instance else None
        properties = _first(self.names[INSTANCER], system and system.settings, instance.parent, instance.object,
                            instance.object.data)
        return properties | (self._read_geometry_nodes(instance) if instance.is_instance and instance.parent else {})

    def _read_geometry_nodes(self, instance) -> dict[str, tuple]:
        """Attributes that geometry nodes have given to an instance."""
        parent = instance.parent
        if parent.as_pointer() not in self.instances:
            self.instances[parent.as_pointer()] = _Instances(parent, self.names[INSTANCER])
        instances = self.instances[parent.as_pointer()]
        if not instances.values or not len(instances.matrices):
            return {}
        index = instances.index(instance)
        return {name: tuple(rows[index].tolist()) for name, rows in instances.values.items()}


def read_layers(data, names, domain: str) -> dict[str, np.ndarray]:
    """(k, c) f32 of the attributes of hair or points that are called `names`, by name."""
    read = {name: _values(data.attributes[name]) for name in names
            if name in data.attributes and data.attributes[name].domain == domain}
    return {name: values for name, values in read.items() if values is not None}


def read_attributes(mesh, names, loop: np.ndarray, vertex: np.ndarray, polygon: np.ndarray) -> dict[str, np.ndarray]:
    """(n, 3, c) f32 of the attributes called `names`, and of all colour attributes, at the corners of n triangles.

    loop, vertex: (n, 3), polygon: (n,) where their values lie. Values of edges go to the ends, as in Cycles.
    """
    names = {*names, *(attribute.name for attribute in mesh.color_attributes)}
    result = {}
    for attribute in mesh.attributes:
        if attribute.name not in names or (values := _values(attribute)) is None:
            continue
        if attribute.domain == "EDGE":
            values = EDGES.get(attribute.data_type, np.asarray)(_at_vertices(mesh, values)).astype(np.float32)
        index = {"CORNER": loop, "FACE": np.repeat(polygon[:, None], 3, axis=1)}.get(attribute.domain, vertex)
        result[attribute.name] = values[index]
    if PER_ISLAND in names:
        island = (jenkins(_islands(mesh)) / LARGEST)[vertex[:, 0]]
        result[PER_ISLAND] = np.broadcast_to(island[:, None, None], (*vertex.shape, 1))
    return result


def _islands(mesh) -> np.ndarray:
    """(vertices,) the vertex that Cycles knows the island of each by: the root of a disjoint set, joined by rank."""
    parent, rank = list(range(len(mesh.vertices))), [0] * len(mesh.vertices)

    def root(x: int) -> int:
        while parent[x] != x:
            parent[x] = x = parent[parent[x]]
        return x

    for i, (x, y) in enumerate(read_values(mesh.edges, "vertices", (2,), np.int32).tolist()):
        if not i % PIECE:
            progress.report()
        x, y = root(x), root(y)
        if x != y:
            if rank[x] < rank[y]:
                x, y = y, x
            parent[y] = x
            rank[x] += rank[x] == rank[y]
    return np.array([root(x) for x in range(len(parent))], np.uint32)


def _at_vertices(mesh, values: np.ndarray) -> np.ndarray:
    """Mean over the edges of each vertex."""
    ends = read_values(mesh.edges, "vertices", (2,), np.int32).ravel()
    twice, count = np.repeat(values, 2, axis=0), np.bincount(ends, minlength=len(mesh.vertices))
    total = np.stack([np.bincount(ends, column, len(mesh.vertices)) for column in twice.T], axis=1)
    return total / np.maximum(count, 1)[:, None]


def _values(attribute) -> np.ndarray | None:
    """(k, c) f32; None of a kind that Cycles does not know."""
    if attribute.data_type not in STORED:
        return None
    name, channels = STORED[attribute.data_type]
    kind = {"INT": np.int32, "INT8": np.int32, "BOOLEAN": bool}.get(attribute.data_type, np.float32)
    return read_values(attribute.data, name, (channels,), kind).astype(np.float32)


def read_values(collection, name: str, shape: tuple[int, ...] = (), dtype=np.float32) -> np.ndarray:
    """(k, *shape) a property of all items of a collection; reading them one by one takes many times as long."""
    values = np.empty((len(collection), *shape), dtype)
    collection.foreach_get(name, values.ravel())
    return values


class _Instances:
    """What geometry nodes instance on an object: (k, 4, 4) matrices, and (k, c) values by name."""

    def __init__(self, obj, names):
        self.matrices, self.values, self.searches = np.zeros((0, 4, 4)), {}, 0
        geometry = obj.evaluated_geometry()  # which owns the cloud
        cloud = geometry.instances_pointcloud()
        if cloud is None or (transform := cloud.attributes.get("instance_transform")) is None:
            return
        self.matrices = read_values(transform.data, "value", (4, 4)).transpose(0, 2, 1)
        attributes = {name: _values(cloud.attributes[name]) for name in names if name in cloud.attributes}
        self.values = {name: values for name, values in attributes.items() if values is not None}
        count, ids = len(self.matrices), cloud.attributes.get("id")
        numbers = range(count) if ids is None else read_values(ids.data, "value", dtype=np.int32).tolist()
        self._indices = dict(zip(reversed(numbers), reversed(range(count)), strict=True))  # the first of those alike
        self._last = -1

    def index(self, instance) -> int:
        """Index of a DepsgraphObjectInstance, or of the one that it belongs to; those of an object come in order."""
        number = [part for part in instance.persistent_id if part != UNUSED][-1]
        if number not in self._indices:  # Blender gives those with the number of another one of their own
            own = np.array(instance.parent.matrix_world.inverted_safe() @ instance.matrix_world)
            index = self._last + 1
            if index == len(self.matrices) or np.abs(self.matrices[index] - own).max() > CLOSE:
                self.searches += 1
                index = int(np.abs(self.matrices - own).max(axis=(1, 2)).argmin())
            self._indices[number] = index
        self._last = self._indices[number]
        return self._last


def _first(names, *blocks) -> dict[str, tuple]:
    """Properties by name: the custom one, or else Blender's own, of the first block that has it."""
    properties = {}
    for name in names:
        values = (_property(block, name) for block in blocks if block is not None)
        if (value := next((value for value in values if value is not None), None)) is not None:
            properties[name] = value
    return properties


def _property(block, name: str) -> tuple | None:
    value = block.get(name)
    if value is None:
        try:
            value = block.path_resolve(name)
        except (ValueError, TypeError, AttributeError):
            return None
    try:
        numbers = tuple(map(float, np.ravel(np.asarray(value, object))))
    except (TypeError, ValueError):
        return None
    return numbers if 1 <= len(numbers) <= 4 else None
