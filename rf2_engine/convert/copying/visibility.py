# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays of Cycles meet: visibility, holdouts, shadow catchers, gas domains, light linking."""
from __future__ import annotations

from dataclasses import dataclass, field

from ....model.surface_kinds import Ray
from ..data.report import Report

RAYS = {"visible_camera": Ray.CAMERA, "visible_diffuse": Ray.DIFFUSE, "visible_glossy": Ray.GLOSSY,
        "visible_transmission": Ray.TRANSMISSION, "visible_volume_scatter": Ray.SCATTER, "visible_shadow": Ray.SHADOW}
MOST_GROUPS = 64  # bits of RenderScene.lit_groups
RECEIVERS = {"MESH", "VOLUME"}  # curves, text and metaballs are instanced as meshes


def is_shown(instance, layer) -> bool:
    """Whether any ray of Cycles meets an instance; `layer` is the evaluated view layer."""
    obj = instance.object
    if not (layer.use_volumes if gas_domain(obj) or obj.type == "VOLUME" else layer.use_solid or obj.type == "LIGHT"):
        return False
    return hidden_rays(instance) != sum(RAYS.values())


def shows_something(instance) -> bool:
    """Whether an instance shows itself, or only its hair, as an emitter without Show Emitter does."""
    return instance.show_self or instance.show_particles


def is_holdout(instance, layer) -> bool:
    """Whether an instance of an object cuts a hole into the film of an evaluated view layer."""
    return _host(instance).holdout_get(view_layer=layer)  # its own, or that of a collection


def hidden_rays(instance) -> int:
    """The rays that do not meet an instance, a set of Ray."""
    objects = instance.object, _host(instance)
    return sum(ray for name, ray in RAYS.items() if not all(getattr(obj, name) for obj in objects))


def _host(instance):
    """What an instancer hides, its instances are too."""
    return instance.parent if instance.is_instance and instance.parent else instance.object


def hidden_in_renders(depsgraph) -> set:
    """Original objects that a viewport's depsgraph holds although renders hide them; empty for that of a render."""
    if depsgraph.mode == "RENDER":
        return set()
    layer, visible = depsgraph.view_layer, set()
    waiting = [layer.layer_collection]
    while waiting:
        collection = waiting.pop()
        if not collection.exclude and not collection.collection.hide_render:
            visible.update(obj for obj in collection.collection.objects if not obj.hide_render)
            waiting += collection.children
    return set(layer.objects) - visible


def has_holdouts(depsgraph) -> bool:
    """Whether an object or a material of the view layer may cut a hole into the film."""
    layer = depsgraph.view_layer_eval
    trees = (data for data in depsgraph.ids if data.id_type == "NODETREE")
    return (any(obj.holdout_get(view_layer=layer) for obj in depsgraph.objects)
            or any(node.type == "HOLDOUT" for tree in trees for node in tree.nodes))


def shadow_catchers(depsgraph) -> list:
    """Evaluated objects, including those that are visible only as instances; lamps use the flag otherwise."""
    return [data for data in depsgraph.ids
            if data.id_type == "OBJECT" and data.type != "LIGHT" and data.is_shadow_catcher]


def catching_hosts(depsgraph) -> list:
    """Evaluated shadow catchers, or what instances them: whose Holdout counts."""
    if not shadow_catchers(depsgraph):
        return []
    hosts = {_host(instance).original for instance in depsgraph.object_instances
             if instance.object.type != "LIGHT" and instance.object.is_shadow_catcher}
    return [host.evaluated_get(depsgraph) for host in hosts]


def gas_domain(obj):
    """Settings of the smoke and fire that Cycles shows inside the domain that this mesh is, never the mesh; or None."""
    return next((modifier.domain_settings for modifier in obj.modifiers
                 if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN" and modifier.domain_settings
                 and modifier.domain_settings.domain_type == "GAS"), None)


@dataclass
class LightLinking:
    """What light linking says of each original object."""

    dark: set = field(default_factory=set)                  # those that shine on nothing that is shown
    group: dict[object, int] = field(default_factory=dict)  # of the surfaces that all lights treat alike
    lit_groups: dict[object, int] = field(default_factory=dict)  # that a linked light lights, bits
    blockers: dict[object, int] = field(default_factory=dict)  # groups that stop its light, bits


def read_light_linking(depsgraph, report: Report) -> LightLinking:
    """What is linked; what of it is lost is reported."""
    linked = [(obj, obj.light_linking.receiver_collection, obj.light_linking.blocker_collection)
              for obj in depsgraph.objects]
    linked = [link for link in linked if any(link[1:])]
    linking = LightLinking()
    if not linked:
        return linking
    visible = list(dict.fromkeys(instance.object.original for instance in depsgraph.object_instances
                                 if instance.object.type in RECEIVERS and shows_something(instance)))
    sets = [[_linked_objects(collection, set(visible)) for collection in collections] for _, *collections in linked]
    groups: dict[tuple, int] = {}
    for obj in visible:
        lights = tuple(obj in objects for both in sets for objects in both)
        linking.group[obj] = groups.setdefault(lights, min(len(groups), MOST_GROUPS - 1))
    if len(groups) > MOST_GROUPS:
        report.approximated("Light Linking", f"{len(groups)} groups of objects are lit by different lights: those "
                                             f"after the first {MOST_GROUPS - 1} are lit as one")
    kinds = linking.lit_groups, linking.blockers
    for i, (obj, *collections) in enumerate(linked):
        for kind, (bits, collection) in enumerate(zip(kinds, collections, strict=True)):
            if collection:
                bits[obj.original] = sum({1 << number for lights, number in groups.items() if lights[2 * i + kind]})
        if collections[0] and not sets[i][0] - {obj.original}:
            linking.dark.add(obj.original)
    return linking


def _linked_objects(collection, visible: set) -> set:
    """The `visible` objects that a collection links to a light: without included ones all but the excluded."""
    if not collection:
        return visible
    links = {"INCLUDE": set(), "EXCLUDE": set()}
    for child, entry in zip(collection.objects, collection.collection_objects, strict=True):
        links[entry.light_linking.link_state].add(child.original)
    for child, entry in zip(collection.children, collection.collection_children, strict=True):
        links[entry.light_linking.link_state].update(obj.original for obj in child.all_objects)
    return visible & (links["INCLUDE"] or visible) - links["EXCLUDE"]
