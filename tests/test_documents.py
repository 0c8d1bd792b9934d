# SPDX-License-Identifier: GPL-3.0-or-later
"""Whoever has the repository can look up every document and section that the code cites."""
import re
from pathlib import Path

import pytest

from tests.sources import ROOT, documents, python_files

NUMBER = r"\d+(?:\.\d+)*"
NUMBERS = rf"{NUMBER}(?:(?:-|, | and |, and ){NUMBER})*"
CITATION = re.compile(rf'([\w./-]+\.md)(?: ({NUMBERS})|, "([^"]+)")?')  # document, sections by number or title
MODULE = re.compile(r"[\w/.]*\w\.py\b")
LINK = re.compile(r"\]\(([^)#:]+)\)")


def cited(text: str) -> list[tuple[str, list[str]]]:
    """(document, sections) of every citation; line ends and comment signs count as spaces."""
    return [(document, [title] if title else re.findall(NUMBER, numbers))
            for document, numbers, title in CITATION.findall(re.sub(r"\s*\n[\s#]*", " ", text))]


def sections(document: Path) -> set[str]:
    """Numbers and titles of the headings of a document."""
    headings = re.findall(rf"^#+ +(?:({NUMBER})\.? +)?(.+)", document.read_text(encoding="utf-8"), re.MULTILINE)
    return {name for heading in headings for name in heading if name}


@pytest.mark.parametrize("text, found", [
    ("(docs/network.md 4.1, 5 and 5.2).", [("docs/network.md", ["4.1", "5", "5.2"])]),
    ("see docs/network.md\n    # 8.3: 2 views", [("docs/network.md", ["8.3"])]),
    ('docs/architecture.md, "The rooms"; README.md',
     [("docs/architecture.md", ["The rooms"]), ("README.md", [])])])
def test_citations_are_recognised(text, found):
    assert cited(text) == found


def test_every_citation_of_the_code_resolves():
    known = {str(path): sections(ROOT / path) for path in documents()}
    lost = [(str(path), document, section) for path in python_files()
            for document, wanted in cited((ROOT / path).read_text(encoding="utf-8"))
            for section in wanted or [None]
            if document not in known or section and section not in known[document]]
    assert lost == []


def test_every_link_between_documents_leads_somewhere():
    links = [(path, link) for path in documents() for link in LINK.findall((ROOT / path).read_text(encoding="utf-8"))]
    assert len(links) > 10 and [link for link in links if not (ROOT / link[0].parent / link[1]).exists()] == []


def test_every_module_that_a_document_names_exists():
    files = [f"/{path.as_posix()}" for path in python_files()]
    named = [(str(path), name) for path in documents()
             for name in MODULE.findall((ROOT / path).read_text(encoding="utf-8"))]
    assert len(named) > 100
    assert [found for found in named if not any(file.endswith(f"/{found[1]}") for file in files)] == []
