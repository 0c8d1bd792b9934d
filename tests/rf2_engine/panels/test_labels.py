# SPDX-License-Identifier: GPL-3.0-or-later
"""Choices are explained where they are, and documents and messages call settings by the names that they have there."""
import re
from collections.abc import Iterator

import bpy
import pytest

from tests.rf2_engine.installed import PACKAGE
from tests.sources import ROOT, documents, python_files

DOCUMENTS = ("README.md", *(f"docs/{name}.md" for name in (
    "compare", "extending", "history", "light", "limits", "measured", "training")))
EMPHASIS = re.compile(r"(?<![*\w])\*([A-Z][^*]*)\*(?!\*)")
SMALL_WORDS = {"a", "and", "as", "by", "for", "from", "in", "of", "the", "to", "with"}
LINE_END = re.compile(r'"?\s*\n[\s#]*f?"?')  # in a message, too


def registered_classes(base: type) -> Iterator[type]:
    """All that add-ons have derived from a class of Blender."""
    for cls in base.__subclasses__():
        if getattr(cls, "is_registered", False):
            yield cls
        yield from registered_classes(cls)


def own_choices() -> Iterator[tuple[str, bpy.types.EnumPropertyItem]]:
    """(place, item) of all properties that this add-on defines."""
    for base in (bpy.types.PropertyGroup, bpy.types.Operator, bpy.types.AddonPreferences):
        for cls in registered_classes(base):
            for prop in cls.bl_rna.properties if cls.__module__.startswith(PACKAGE) else ():
                if prop.type == "ENUM" and prop.identifier not in base.bl_rna.properties:
                    yield from ((f"{cls.__name__}.{prop.identifier}", item) for item in prop.enum_items)


def all_labels() -> set[str]:
    """Names of all settings and choices, panels and operators, ours and Blender's."""
    labels = set()
    for cls in (*(getattr(bpy.types, name) for name in dir(bpy.types)), *registered_classes(bpy.types.PropertyGroup),
                *registered_classes(bpy.types.AddonPreferences)):
        labels.add(getattr(cls, "bl_label", ""))
        for prop in cls.bl_rna.properties if hasattr(cls, "bl_rna") else ():
            labels.add(prop.name)
            labels.update(item.name for item in (prop.enum_items if prop.type == "ENUM" else ()))
    return labels


def is_title(text: str) -> bool:
    return all(word[0].isupper() or word in SMALL_WORDS for word in text.split())


def test_every_choice_says_what_it_does(scene):
    choices = list(own_choices())
    assert len({place for place, _ in choices}) > 12
    assert [(place, item.name) for place, item in choices if item.description in ("", item.name)] == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_documents_call_settings_by_their_names(scene, document):
    text = (ROOT / document).read_text(encoding="utf-8")
    named = {" ".join(words.split()) for words in EMPHASIS.findall(text)}
    titles = {words for words in named if is_title(words)}
    assert titles and sorted(titles - all_labels()) == []


def test_documents_and_messages_lead_to_settings_that_exist(scene):
    places = {"Light": {item.name for item in scene.renderformer_v2.bl_rna.properties["light"].enum_items},
              "Render Properties": {"Render Engine"} | {
                  panel.bl_label for panel in registered_classes(bpy.types.Panel)
                  if getattr(panel, "bl_context", "") == "render" and panel.__module__.startswith(PACKAGE)}}
    ways = []
    for path in (*documents(), *python_files()):
        text = LINE_END.sub(" ", (ROOT / path).read_text(encoding="utf-8")).replace("  ", " ")
        ways += [(str(path), place, way) for place in places
                 for way in re.findall(rf"\b{place} > ([A-Z].{{30}})", text)]
    assert len(ways) > 10
    assert [way for way in ways if not way[2].startswith(tuple(places[way[1]]))] == []
