# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials, lamps and worlds copied out of Blender, each once."""
from __future__ import annotations

import bpy
import numpy as np

from ....model.surface_kinds import Ray
from ... import compat
from ...material_settings import latent_of
from ..data.blocks import Conventions, Lamp, Material, Tree, World
from .image_files import scene_linear
from .images import Images, UnreadImages
from .trees import VALUES, Trees, plain

REC709 = "Linear Rec.709"
VISIBILITY = {"diffuse": Ray.DIFFUSE, "glossy": Ray.GLOSSY, "transmission": Ray.TRANSMISSION, "scatter": Ray.SCATTER}


class Blocks:
    """The data-blocks of one conversion."""

    def __init__(self, frame: int, depsgraph: bpy.types.Depsgraph | None = None, images: dict | None = None,
                 reads_images: bool = True):
        """frame: that image sequences show; depsgraph: whose evaluated versions of data-blocks are copied; images: what
        is `known` of them (`Images`); reads_images: else all are grey."""
        self.depsgraph = depsgraph
        self._trees = Trees(Images(frame, images) if reads_images else UnreadImages(), _conventions())
        self._copies: dict[int, object] = {}

    def of(self, block: bpy.types.ID | None) -> Material | Lamp | World | None:
        """A copy of a material, a lamp or a world."""
        if block is None:
            return None
        if self.depsgraph is not None and not block.is_evaluated:
            block = block.evaluated_get(self.depsgraph)
        key = block.as_pointer()
        if key not in self._copies:
            self._copies[key] = COPIES[block.id_type](block, self._tree(block))
        return self._copies[key]

    @property
    def materials(self) -> list[Material]:
        """The materials that were copied."""
        return [block for block in self._copies.values() if isinstance(block, Material)]

    def _tree(self, block) -> Tree | None:
        return self._trees.copied(block.node_tree) if block.use_nodes and block.node_tree else None


def _material(block, tree: Tree | None) -> Material:
    return Material(block.name, tree, block.pass_index, tuple(block.diffuse_color), block.displacement_method,
                    latent_of(block))


def _lamp(block, tree: Tree | None) -> Lamp:
    values = {prop.identifier: plain(getattr(block, prop.identifier)) for prop in block.bl_rna.properties
              if prop.type in VALUES and prop.identifier not in bpy.types.ID.bl_rna.properties}
    return Lamp(**values | {"name": block.name, "node_tree": tree,
                            "is_portal": block.type == "AREA" and block.cycles.is_portal})


def _world(block, tree: Tree | None) -> World:
    nodes = block.node_tree.nodes if tree else ()
    return World(block.name, tree, tuple(block.color),
                 sum(ray for key, ray in VISIBILITY.items() if not getattr(block.cycles_visibility, key)),
                 [node.image.size[0] for node in nodes if getattr(node, "image", None)],
                 any(node.bl_idname == "ShaderNodeGroup" for node in nodes))


COPIES = {"MATERIAL": _material, "LIGHT": _lamp, "WORLD": _world}


def _conventions() -> Conventions:
    space, primaries = compat.working_space(), np.eye(3, dtype=np.float32)
    return Conventions(primaries if space == REC709 else scene_linear(primaries, REC709), compat.voronoi_uses_pcg())
