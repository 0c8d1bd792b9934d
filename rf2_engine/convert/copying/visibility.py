# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the instances that the rendered view layer shows, and report visibility settings that are ignored."""
from __future__ import annotations

RAYS = ("visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow")


def is_shown(instance, layer, report) -> bool:
    """Whether any ray of Cycles meets an instance; `layer` is the evaluated view layer."""
    obj = instance.object
    if not (layer.use_volumes if gas_domain(obj) or obj.type == "VOLUME" else layer.use_solid or obj.type == "LIGHT"):
        return False
    host = instance.parent if instance.is_instance and instance.parent else obj  # an instancer hides what it instances
    rays = [getattr(obj, ray) and getattr(host, ray) for ray in RAYS]
    if not any(rays) and not (obj.visible_camera and host.visible_camera):
        return False
    if not all(rays):
        report.approximated(obj.name, "Ray Visibility other than Camera is ignored")
    if obj.type == "LIGHT":
        return True
    if host.holdout_get(view_layer=layer):  # its own, or that of a collection
        report.approximated(obj.name, "a holdout lights the scene like any object")
    return True


def hidden_in_renders(depsgraph) -> set:
    """Original objects that a viewport's depsgraph holds although renders hide them; empty for that of a render."""
    if depsgraph.mode == "RENDER":
        return set()
    layer, shown = depsgraph.view_layer, set()
    waiting = [layer.layer_collection]
    while waiting:
        found = waiting.pop()
        if not found.exclude and not found.collection.hide_render:
            shown.update(obj for obj in found.collection.objects if not obj.hide_render)
            waiting += found.children
    return set(layer.objects) - shown


def has_holdouts(depsgraph) -> bool:
    """Whether an object or a material of the view layer may cut a hole into the film."""
    layer = depsgraph.view_layer_eval
    trees = (data for data in depsgraph.ids if data.id_type == "NODETREE")
    return (any(obj.holdout_get(view_layer=layer) for obj in depsgraph.objects)
            or any(node.type == "HOLDOUT" for tree in trees for node in tree.nodes))


def shadow_catchers(depsgraph) -> list:
    """Evaluated objects, those too that show only as instances of others; for lamps the flag means something else."""
    return [data for data in depsgraph.ids
            if data.id_type == "OBJECT" and data.type != "LIGHT" and data.is_shadow_catcher]


def catching_hosts(depsgraph) -> list:
    """Evaluated shadow catchers, or what instances them: whose Holdout counts."""
    if not shadow_catchers(depsgraph):
        return []
    hosts = {(instance.parent if instance.is_instance and instance.parent else instance.object).original
             for instance in depsgraph.object_instances
             if instance.object.type != "LIGHT" and instance.object.is_shadow_catcher}
    return [host.evaluated_get(depsgraph) for host in hosts]


def gas_domain(obj):
    """Settings of the smoke and fire that Cycles shows inside the domain that this mesh is, never the mesh; or None."""
    return next((modifier.domain_settings for modifier in obj.modifiers
                 if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN" and modifier.domain_settings
                 and modifier.domain_settings.domain_type == "GAS"), None)
