# SPDX-License-Identifier: GPL-3.0-or-later
"""List and download repositories of the Hugging Face Hub in a process of its own: to cancel is to end it.

A program, not a module of the add-on: `python -P hub_worker.py` reads a line of JSON from standard input,
    {"fetch": bool, "target": folder, "token": str or "",
     "repositories": [{"id", "revision" (null: head), "folder", "parts": [file or folder/], "sha256": {file: hash}}]}
and writes lines of JSON: {"total", "present" (bytes), "text"}, or at the end {"error", "status" (HTTP or null), "steps"
([[what to do, address or ""]])}.

A file gets its final name once it is complete and has the repository's hash; until then it is FILE.HASH.part, and the
next start appends to it. One process at a time writes into a target. We use only the listing and `http_get` of
huggingface_hub: its download function deletes what an interrupted download left.
"""
from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import shutil
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

SUFFIXES = {".safetensors", ".json", ".yaml", ".yml"}  # never pickles
INTERVAL = 0.2  # seconds between two messages
RESUMABLE = "what has arrived is kept, the next download continues from there"
LOGIN = "unexpected answer: does this network require a login in the browser?"
IN_THE_WAY = "a file is where a folder should be"
REASONS = {errno.ENOENT: "it was removed or renamed", errno.EEXIST: IN_THE_WAY, errno.ENOTDIR: IN_THE_WAY}


@dataclass
class RemoteFile:
    url: str
    path: Path
    size: int
    sha256: str  # of the content, for large files
    blob: str    # Git's SHA-1 of the others
    repository: str

    @property
    def part(self) -> Path:
        return self.path.with_name(f"{self.path.name}.{(self.sha256 or self.blob)[:12]}.part")

    def is_intact(self, path: Path) -> bool:
        """Whether the file at `path` is this one."""
        if not path.is_file() or path.stat().st_size != self.size:
            return False
        digest = hashlib.sha256() if self.sha256 else hashlib.sha1(b"blob %d\0" % self.size)
        with open(path, "rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
        return digest.hexdigest() == (self.sha256 or self.blob)

    def present(self) -> int:
        """Bytes that need not be downloaded."""
        if self.is_intact(self.path):
            return self.size
        return self.part.stat().st_size if self.part.is_file() else 0


class PartFile(io.FileIO):
    """A part of a file, opened for appending; reports its length. A wrong answer does not cost what has arrived."""

    def __init__(self, file: RemoteFile, report_length):
        super().__init__(file.part, "ab+")
        self.file, self.report_length, self.is_sent_again = file, report_length, False

    def truncate(self, size=None) -> int:
        """http_get does this when a server sends the file again; the part is kept and compared with it."""
        self.is_sent_again = True
        return self.tell()

    def write(self, data) -> int:
        present = self.read(len(data)) if self.is_sent_again else b""
        if not data.startswith(present):
            raise ExplainedError(f"{self.file.path.name}: {LOGIN}")
        rest = memoryview(data)[len(present):]
        while rest:  # a full disk takes only some of it
            rest = rest[super().write(rest):]
        self.report_length(self.tell())
        return len(data)


def list_files(repository: dict, target: Path, token: str) -> list[RemoteFile]:
    """The requested files of a repository, all of one revision."""
    from huggingface_hub import HfApi, constants, hf_hub_url

    api = HfApi(token=token or False)  # False: send no login that other programs keep on this computer
    info = api.model_info(repository["id"], revision=repository.get("revision"), files_metadata=True,
                          timeout=constants.HF_HUB_DOWNLOAD_TIMEOUT)
    files, pinned = [], repository.get("sha256", {})
    for entry in info.siblings or ():
        name = PurePosixPath(entry.rfilename)
        is_requested = any(entry.rfilename == part or (part.endswith("/") and entry.rfilename.startswith(part))
                           for part in repository["parts"])
        if is_requested and name.suffix in SUFFIXES and ".." not in name.parts and "\\" not in entry.rfilename:
            url = hf_hub_url(repository["id"], entry.rfilename, revision=info.sha)
            sha256 = entry.lfs.sha256 if entry.lfs else ""
            if sha256 and sha256 != pinned.get(entry.rfilename, sha256):
                raise ExplainedError(f"{repository['id']}: {entry.rfilename} is not the file that this add-on knows")
            files.append(RemoteFile(url, target / repository["folder"] / name, entry.size,
                                    pinned.get(entry.rfilename, sha256), entry.blob_id, repository["id"]))
    if not files or pinned.keys() - {file.path.relative_to(target / repository["folder"]).as_posix() for file in files}:
        raise ExplainedError(f"{repository['id']} does not hold the expected files")
    return files


def download(file: RemoteFile, token: str, report_length) -> None:
    """Complete a file from the end of its part; http_get retries a few times when no data arrive."""
    from huggingface_hub import constants
    from huggingface_hub.file_download import http_get
    from huggingface_hub.utils import build_hf_headers

    constants.DOWNLOAD_CHUNK_SIZE = 1 << 16  # instead of 10 MB, which every interruption would lose
    file.path.parent.mkdir(parents=True, exist_ok=True)
    if file.part.is_file() and file.part.stat().st_size > file.size:
        file.part.unlink()
    with PartFile(file, report_length) as stream:
        length = stream.seek(0, os.SEEK_END)
        try:
            http_get(file.url, stream, resume_size=length, headers=build_hf_headers(token=token or False),
                     expected_size=file.size)
        except OSError as error:
            if type(error) is OSError and error.errno is None:  # http_get's own, about the size
                os.truncate(stream.fileno(), length)
                raise ExplainedError(f"{file.path.name}: {LOGIN}") from error
            raise
    if not file.is_intact(file.part):
        file.part.unlink()
        raise ExplainedError(f"{file.path.name} arrived damaged: download again")
    file.part.replace(file.path)


def lock(target: Path, taken: str) -> None:
    """Keep other processes from downloading into the folder until this one ends, however it ends.

    Raises ExplainedError(taken) if another one does.
    """
    descriptor = os.open(target / ".lock", os.O_RDWR | os.O_CREAT)  # never closed, which would end the lock
    try:
        if sys.platform == "win32":
            import msvcrt
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        raise ExplainedError(taken) from error
    except OSError:
        pass  # some network folders have no locks


def require_space(target: Path, needed: int) -> None:
    """Raises ExplainedError if `needed` bytes do not fit on the disk of `target`."""
    free = shutil.disk_usage(target).free
    if free < needed:
        raise ExplainedError(f"the disk of {target} has too little space: {-(-needed // 100_000) / 10} MB are needed, "
                             f"{free // 100_000 / 10} MB are free")


def run(request: dict, send) -> None:
    """Do what is requested; send(**message) is called with "total", "present", "text" whenever they change."""
    target, token = Path(request["target"]), request["token"]
    if not all("!" <= character <= "~" for character in token):
        raise ExplainedError("the access token has an invalid character: copy it again", 401)
    files = []
    for repository in request["repositories"]:
        send(total=0, present=0, text=f"Asking for {repository['id']}")
        with explaining(repository["id"], request, repository["id"]):
            files += list_files(repository, target, token)
    if request["fetch"]:
        target.mkdir(parents=True, exist_ok=True)
        lock(target, f"another Blender is downloading these weights to {target}")  # before looking at existing files
    present = {file.path: file.present() for file in files}
    total = sum(file.size for file in files)
    missing = [file for file in files if present[file.path] != file.size or not file.path.is_file()]
    send(total=total, present=sum(present.values()), text="")
    if not request["fetch"]:
        return
    require_space(target, total - sum(present.values()))
    last = 0.0

    def report_length(file: RemoteFile, length: int) -> None:
        nonlocal last
        present[file.path] = length
        if time.monotonic() - last > INTERVAL:
            last = time.monotonic()
            send(total=total, present=sum(present.values()), text=f"{file.path.parent.name}/{file.path.name}")

    for file in missing:
        last = 0.0  # a new file is reported at once
        report_length(file, present[file.path])
        with explaining(file.url, request, file.repository):
            download(file, token, partial(report_length, file))
    send(total=total, present=total, text="")


class ExplainedError(Exception):
    """An error in words for the user, with the HTTP status of the server, if any, and the steps that help."""

    def __init__(self, message: str, status: int | None = None, steps: list[tuple[str, str]] = ()):
        super().__init__(message)
        self.status, self.steps = status, steps


@contextmanager
def explaining(what: str, request: dict, repository: str = ""):
    """Raise every error as ExplainedError; `what` is requested or written."""
    try:
        yield
    except ExplainedError:
        raise
    except Exception as error:
        raise explain(error, what, request, repository) from error


def explain(error: Exception, what: str, request: dict, repository: str = "") -> ExplainedError:
    from huggingface_hub import constants

    status = getattr(getattr(error, "response", None), "status_code", None)
    if status in (401, 403):
        answer = "refuses this access token" if request["token"] else "asks for an access token (or does not exist)"
        return ExplainedError(f"{what} {answer}", status, access_steps(constants.ENDPOINT, repository))
    if status == 404:
        return ExplainedError(f"{what} was not found on {constants.ENDPOINT}", status)
    if isinstance(error, json.JSONDecodeError):
        return ExplainedError(f"{what}: {LOGIN}")
    if isinstance(error, OSError) and error.errno and type(error).__module__ == "builtins":  # of the disk
        return explain_disk(request["target"], error)
    return ExplainedError(f"{what}: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''} "
                          f"(check the connection; {RESUMABLE})", status)


def access_steps(site: str, repository: str) -> list[tuple[str, str]]:
    """The steps to get access to a repository that is not open to all, each with its web page."""
    return [("Log in, or make an account", f"{site}/login"),
            ("Accept the conditions on the repository's page. Its owners may have to grant access",
             f"{site}/{repository}"),
            ("Make a token of the kind Read, and copy it", f"{site}/settings/tokens"),
            ("Paste it into Access Token, and press Download again", "")]


def explain_disk(target: str, error: OSError, remainder: str = RESUMABLE) -> ExplainedError:
    """The error for a folder that cannot be used; `remainder` says what is left of a download when the disk is full."""
    reason = (f"the disk is full ({remainder})" if error.errno == errno.ENOSPC
              else REASONS.get(error.errno, error.strerror))
    return ExplainedError(f"the folder {target} cannot be used: {reason}")


def main() -> int:
    request = json.loads(sys.stdin.readline())
    channel, sys.stdout = sys.stdout, sys.stderr  # libraries must not print into the messages

    def send(**message) -> None:
        print(json.dumps(message), file=channel, flush=True)

    try:
        with explaining(request["target"], request):
            run(request, send)
    except Exception as error:
        send(error=str(error) or type(error).__name__, status=getattr(error, "status", None),
             steps=getattr(error, "steps", ()))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
