# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.datagen.manifest FOLDER: check the samples of a folder, of one machine or of many.

tools.datagen writes a line of JSON for each sample into a manifest_*.jsonl beside it, another file for each of its
processes, so that folders of several machines are merged by copying one into the other. This command compares each
sample with its line by size and SHA-256. A sample without a line is read as a whole and gets one. What is missing,
changed or cannot be read is named, training leaves out what it cannot read, and the exit status is 1.
"""
from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import zipfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from pathlib import Path

from .sample_files import Facts, read_facts, sample_paths

ADDED = "manifest_found.jsonl"  # lines of samples that had none


def make_entry(path: Path) -> dict:
    """What the manifest says of a sample. A damaged file raises whatever the damage leads to."""
    return {"file": path.name, **_read_content(path)} | asdict(read_facts(path))


def append_entries(manifest: Path, entries: Iterable[dict]) -> None:
    with open(manifest, "a", encoding="utf-8") as file:
        file.writelines(json.dumps(entry) + "\n" for entry in entries)


def read_entries(folder: Path) -> dict[str, dict]:
    """The newest line of each sample, by the name of its file. Lines that were cut off by a kill are left out."""
    entries = {}
    for manifest in sorted(folder.glob("manifest_*.jsonl"), key=lambda path: path.stat().st_mtime_ns):
        for text in manifest.read_text(encoding="utf-8").splitlines():
            try:
                entry = json.loads(text)
                entries[entry["file"]] = entry
            except (ValueError, KeyError, TypeError):
                continue
    return entries


def facts_from_entry(entry: dict) -> Facts:
    """Raises KeyError for a line of an older version."""
    return Facts(**{f.name: entry[f.name] for f in fields(Facts)})


def find_problem(path: Path, entry: dict) -> str | None:
    """What is wrong with a sample of the manifest."""
    if not path.is_file():
        return "is missing"
    if path.stat().st_size != entry["bytes"]:
        return f"has {path.stat().st_size} bytes instead of {entry['bytes']}"
    return None if _read_content(path)["sha256"] == entry["sha256"] else "has another content than when it was made"


def check(folder: Path) -> tuple[list[str], dict[str, dict]]:
    """Sentences about what is wrong, and the lines of all samples that are as they should be."""
    known, paths = read_entries(folder), {path.name: path for path in sample_paths(folder)}
    new = [path for name, path in paths.items() if name not in known]
    problems, added = [], []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        wrong = dict(zip(known, pool.map(find_problem, (folder / name for name in known), known.values())))
        for path, entry in zip(new, pool.map(_entry_or_problem, new)):
            if isinstance(entry, str):
                problems.append(f"{path}: {entry}")
            else:
                added.append(entry)
    if added:
        append_entries(folder / ADDED, added)
    problems += [f"{folder / name}: {sentence}" for name, sentence in wrong.items() if sentence]
    good = {name: entry for name, entry in known.items() if not wrong[name]}
    return sorted(problems), good | {entry["file"]: entry for entry in added}


def _read_content(path: Path) -> dict:
    with open(path, "rb") as file:
        return {"bytes": path.stat().st_size, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


def _entry_or_problem(path: Path) -> dict | str:
    try:
        with zipfile.ZipFile(path) as archive:
            if broken := archive.testzip():
                return f"cannot be read ({broken})"
        return make_entry(path)
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        return f"cannot be read ({error})"


def summarize(entries: Iterable[dict]) -> str:
    """How much there is, in a sentence for each kind."""
    entries = list(entries)
    if not entries:
        return "no samples"
    triangles = sorted(entry["triangles"] for entry in entries)
    kinds = (f"{sum(entry[f.name] for entry in entries)} with {f.name}" for f in fields(Facts) if f.type == "bool")
    return (f"{len(entries)} samples, {sum(entry['views'] for entry in entries)} views, "
            f"{sum(entry['bytes'] for entry in entries) / 1e6:.1f} MB, {triangles[0]} to {triangles[-1]} triangles "
            f"(median {triangles[len(triangles) // 2]}); " + ", ".join(kinds))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.datagen.manifest", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    folder = parser.parse_args().folder
    if not folder.is_dir():
        print(f"there is no folder {folder}", file=sys.stderr)
        return 2
    problems, good = check(folder)
    print(summarize(good.values()))
    for sentence in problems:
        print(sentence, file=sys.stderr)
    if problems:
        print(f"{len(problems)} to be made again: delete what is there, and run tools.datagen with the same seeds",
              file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
