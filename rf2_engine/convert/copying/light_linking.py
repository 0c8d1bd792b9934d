# SPDX-License-Identifier: GPL-3.0-or-later
"""Light linking: tokens light everything, so an emitter is left out only if nothing that it lights is there."""
from __future__ import annotations

RECEIVERS = {"MESH", "VOLUME"}  # curves, text and metaballs are instanced as meshes


def dark_emitters(depsgraph, report) -> set:
    """Original objects that shine on nothing that is shown; what else linking loses is reported."""
    linked = [obj for obj in depsgraph.objects if obj.light_linking.receiver_collection]
    for obj in depsgraph.objects:
        if obj.light_linking.blocker_collection:
            report.approximated(obj.name, "shadow linking is ignored: everything casts shadows in its light")
    if not linked:
        return set()
    shown = {instance.object.original for instance in depsgraph.object_instances
             if instance.object.type in RECEIVERS and instance.show_self}
    dark = set()
    for obj in linked:
        lit = _lit(obj.light_linking.receiver_collection, shown - {obj.original})
        if not lit:
            dark.add(obj.original)
        elif lit != shown - {obj.original}:
            report.approximated(obj.name, "light linking is ignored: it lights everything")
    return dark


def _lit(collection, shown: set) -> set:
    """Those of `shown` that a receiver collection lets light reach: all but the excluded where it includes none."""
    links = {"INCLUDE": set(), "EXCLUDE": set()}
    for child, entry in zip(collection.objects, collection.collection_objects, strict=True):
        links[entry.light_linking.link_state].add(child.original)
    for child, entry in zip(collection.children, collection.collection_children, strict=True):
        links[entry.light_linking.link_state].update(obj.original for obj in child.all_objects)
    return shown & (links["INCLUDE"] or shown) - links["EXCLUDE"]
