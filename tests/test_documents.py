# SPDX-License-Identifier: GPL-3.0-or-later
"""Documents, sections, files and numbers that code and documents cite exist."""
import re
from pathlib import Path

import pytest

from tests.sources import ROOT, documents, python_files

NUMBER = r"\d+(?:\.\d+)*"
NUMBERS = rf"{NUMBER}(?:(?:-|, | and |, and ){NUMBER})*"
CITATION = re.compile(rf'([\w./-]+\.md)(?: ({NUMBERS})|, "([^"]+)")?')  # document, sections by number or title
MODULE = re.compile(r"[\w/.]*\w\.py\b")
FOLDER_OR_FILE = re.compile(r"`((?:docs|examples|model|rf2_engine|tests|tools)/[\w./-]*)`")
LINK = re.compile(r"\]\(([^)#:]+)\)")
LINKED_SECTIONS = re.compile(rf"\]\(([\w-]+\.md)\) ({NUMBERS})")
DECIBELS = re.compile(r"\b(\d+\.\d+) dB")


def cited(text: str) -> list[tuple[str, list[str]]]:
    """(document, sections) of every citation; line ends and comment signs count as spaces."""
    return [(document, [title] if title else re.findall(NUMBER, numbers))
            for document, numbers, title in CITATION.findall(re.sub(r"\s*\n[\s#]*", " ", text))]


def sections(document: Path) -> set[str]:
    """Numbers and titles of the headings of a document."""
    headings = re.findall(rf"^#+ +(?:({NUMBER})\.? +)?(.+)", document.read_text(encoding="utf-8"), re.MULTILINE)
    return {name for heading in headings for name in heading if name}


def text_of(document: Path | str) -> str:
    return (ROOT / document).read_text(encoding="utf-8")


@pytest.mark.parametrize("text, citations", [
    ("(docs/network.md 4.1, 5 and 5.2).", [("docs/network.md", ["4.1", "5", "5.2"])]),
    ("see docs/network.md\n    # 8.3: 2 views", [("docs/network.md", ["8.3"])]),
    ('docs/architecture.md, "The rooms"; README.md',
     [("docs/architecture.md", ["The rooms"]), ("README.md", [])])])
def test_citations_are_recognised(text, citations):
    assert cited(text) == citations


def test_every_citation_of_the_code_resolves():
    known = {str(path): sections(ROOT / path) for path in documents()}
    lost = [(str(path), document, section) for path in python_files() for document, named in cited(text_of(path))
            for section in named or [None]
            if document not in known or section and section not in known[document]]
    assert lost == []


def test_every_link_between_documents_leads_somewhere():
    links = [(path, link) for path in documents() for link in LINK.findall(text_of(path))]
    assert len(links) > 10 and [link for link in links if not (ROOT / link[0].parent / link[1]).exists()] == []


def test_every_section_that_a_document_links_exists():
    links = [(path, path.parent / name, section) for path in documents()
             for name, numbers in LINKED_SECTIONS.findall(text_of(path).replace("\n", " "))
             for section in re.findall(NUMBER, numbers)]
    assert len(links) > 10
    assert [link for link in links if link[2] not in sections(ROOT / link[1])] == []


def test_every_module_that_a_document_names_exists():
    files = [f"/{path.as_posix()}" for path in python_files()]
    modules = [(str(path), name) for path in documents() for name in MODULE.findall(text_of(path))]
    assert len(modules) > 100
    assert [module for module in modules if not any(file.endswith(f"/{module[1]}") for file in files)] == []


def test_every_path_that_a_document_names_exists():
    paths = [(str(path), name) for path in documents() for name in FOLDER_OR_FILE.findall(text_of(path))]
    assert len(paths) > 50 and [path for path in paths if not (ROOT / path[1]).exists()] == []


def test_decibels_of_the_readme_are_those_of_the_measurements():
    numbers, measured = DECIBELS.findall(text_of("README.md")), re.findall(r"\b\d+\.\d+\b", text_of("docs/measured.md"))
    assert len(numbers) > 5 and [number for number in numbers if number not in measured] == []
