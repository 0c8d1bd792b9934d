# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists and downloads repositories of the Hugging Face Hub in a process of its own, so that cancelling is ending it.

A program, not a module of the add-on: `python -P hub_worker.py` reads a line of JSON from standard input,
    {"fetch": bool, "target": folder, "token": str or "",
     "repositories": [{"id", "revision" (null: head), "folder", "parts": [file or folder/], "sha256": {file: hash}}]}
and writes one a line: {"total", "present" (bytes), "text"}, or at the end {"error", "status" (HTTP or null), "steps"
([[what to do, address or ""]])}.

A file has its final name only when it is complete and has the repository's hash; before that it is FILE.HASH.part,
to which the next start appends. One process at a time writes into a target. huggingface_hub's own download function
deletes what a break-off left, so only its listing and its `http_get` are used.
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
KEPT = "what has arrived is kept, the next download continues from there"
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
    """Opened for appending; says how far it is after each write. Nothing that has arrived is lost to a wrong answer."""

    def __init__(self, file: RemoteFile, tell_length):
        super().__init__(file.part, "ab+")
        self.file, self.tell_length, self.sent_again = file, tell_length, False

    def truncate(self, size=None) -> int:
        """http_get does this when a server sends all again; what is there is compared with that instead."""
        self.sent_again = True
        return self.tell()

    def write(self, data) -> int:
        known = self.read(len(data)) if self.sent_again else b""
        if not data.startswith(known):
            raise Explained(f"{self.file.path.name}: {LOGIN}")
        rest = memoryview(data)[len(known):]
        while rest:  # a disk that gets full takes some of it
            rest = rest[super().write(rest):]
        self.tell_length(self.tell())
        return len(data)


def list_files(repository: dict, target: Path, token: str) -> list[RemoteFile]:
    """What is wanted of a repository, all of one revision."""
    from huggingface_hub import HfApi, constants, hf_hub_url

    api = HfApi(token=token or False)  # False: a login that is kept elsewhere on this computer is not ours to send
    info = api.model_info(repository["id"], revision=repository.get("revision"), files_metadata=True,
                          timeout=constants.HF_HUB_DOWNLOAD_TIMEOUT)
    files, known = [], repository.get("sha256", {})
    for entry in info.siblings or ():
        name = PurePosixPath(entry.rfilename)
        wanted = any(entry.rfilename == part or (part.endswith("/") and entry.rfilename.startswith(part))
                     for part in repository["parts"])
        if wanted and name.suffix in SUFFIXES and ".." not in name.parts and "\\" not in entry.rfilename:
            url = hf_hub_url(repository["id"], entry.rfilename, revision=info.sha)
            told = entry.lfs.sha256 if entry.lfs else ""
            if told and told != known.get(entry.rfilename, told):
                raise Explained(f"{repository['id']}: {entry.rfilename} is not the file that this add-on knows")
            files.append(RemoteFile(url, target / repository["folder"] / name, entry.size,
                                    known.get(entry.rfilename, told), entry.blob_id, repository["id"]))
    if not files or known.keys() - {file.path.relative_to(target / repository["folder"]).as_posix() for file in files}:
        raise Explained(f"{repository['id']} does not hold the expected files")
    return files


def download(file: RemoteFile, token: str, tell_length) -> None:
    """Complete one file, from where its part ends; http_get starts again a few times when the data stop coming."""
    from huggingface_hub import constants
    from huggingface_hub.file_download import http_get
    from huggingface_hub.utils import build_hf_headers

    constants.DOWNLOAD_CHUNK_SIZE = 1 << 16  # as shipped 10 MB, which are lost at every break-off
    file.path.parent.mkdir(parents=True, exist_ok=True)
    if file.part.is_file() and file.part.stat().st_size > file.size:
        file.part.unlink()
    with PartFile(file, tell_length) as stream:
        length = stream.seek(0, os.SEEK_END)
        try:
            http_get(file.url, stream, resume_size=length, headers=build_hf_headers(token=token or False),
                     expected_size=file.size)
        except OSError as error:
            if type(error) is OSError and error.errno is None:  # http_get's own, about the size
                os.truncate(stream.fileno(), length)
                raise Explained(f"{file.path.name}: {LOGIN}") from error
            raise
    if not file.is_intact(file.part):
        file.part.unlink()
        raise Explained(f"{file.path.name} arrived damaged: download again")
    file.part.replace(file.path)


def lock(target: Path, taken: str) -> None:
    """Keeps other processes from downloading into the folder until this one ends, however it ends.

    Raises Explained(taken) when another one does it.
    """
    descriptor = os.open(target / ".lock", os.O_RDWR | os.O_CREAT)  # not closed: that would be the end of the lock
    try:
        if sys.platform == "win32":
            import msvcrt
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        raise Explained(taken) from error
    except OSError:
        pass  # some network folders have no locks


def require_space(target: Path, needed: int) -> None:
    """Raises Explained when so many bytes do not fit on the disk of `target`."""
    free = shutil.disk_usage(target).free
    if free < needed:
        raise Explained(f"the disk of {target} has too little space: {-(-needed // 100_000) / 10} MB are needed, "
                        f"{free // 100_000 / 10} MB are free")


def run(request: dict, tell) -> None:
    """tell(**message) is called with "total", "present", "text" whenever they change."""
    target, token = Path(request["target"]), request["token"]
    if not all("!" <= character <= "~" for character in token):
        raise Explained("the access token has an invalid character: copy it again", 401)
    files = []
    for repository in request["repositories"]:
        tell(total=0, present=0, text=f"Asking for {repository['id']}")
        with explaining(repository["id"], request, repository["id"]):
            files += list_files(repository, target, token)
    if request["fetch"]:
        target.mkdir(parents=True, exist_ok=True)
        lock(target, f"another Blender is downloading these weights to {target}")  # before looking at what is there
    present = {file.path: file.present() for file in files}
    total = sum(file.size for file in files)
    missing = [file for file in files if present[file.path] != file.size or not file.path.is_file()]
    tell(total=total, present=sum(present.values()), text="")
    if not request["fetch"]:
        return
    require_space(target, total - sum(present.values()))
    last = 0.0

    def tell_length(file: RemoteFile, length: int) -> None:
        nonlocal last
        present[file.path] = length
        if time.monotonic() - last > INTERVAL:
            last = time.monotonic()
            tell(total=total, present=sum(present.values()), text=f"{file.path.parent.name}/{file.path.name}")

    for file in missing:
        last = 0.0  # a new file is told at once
        tell_length(file, present[file.path])
        with explaining(file.url, request, file.repository):
            download(file, token, partial(tell_length, file))
    tell(total=total, present=total, text="")


class Explained(Exception):
    """An error in the user's words, with the HTTP status if the server gave one, and the steps that help."""

    def __init__(self, message: str, status: int | None = None, steps: list[tuple[str, str]] = ()):
        super().__init__(message)
        self.status, self.steps = status, steps


@contextmanager
def explaining(what: str, request: dict, repository: str = ""):
    """Raises every error as Explained; `what` is asked for or written."""
    try:
        yield
    except Explained:
        raise
    except Exception as error:
        raise explained(error, what, request, repository) from error


def explained(error: Exception, what: str, request: dict, repository: str = "") -> Explained:
    from huggingface_hub import constants

    status = getattr(getattr(error, "response", None), "status_code", None)
    if status in (401, 403):
        asks = "refuses this access token" if request["token"] else "asks for an access token (or does not exist)"
        return Explained(f"{what} {asks}", status, access_steps(constants.ENDPOINT, repository))
    if status == 404:
        return Explained(f"{what} was not found on {constants.ENDPOINT}", status)
    if isinstance(error, json.JSONDecodeError):
        return Explained(f"{what}: {LOGIN}")
    if isinstance(error, OSError) and error.errno and type(error).__module__ == "builtins":  # not of a network library
        return unusable(request["target"], error)
    return Explained(f"{what}: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''} "
                     f"(check the connection; {KEPT})", status)


def access_steps(site: str, repository: str) -> list[tuple[str, str]]:
    """How to get at a repository that is not open to all, each step with the page where that is done."""
    return [("Log in, or make an account", f"{site}/login"),
            ("Accept the conditions on the repository's page. Its owners may have to grant access",
             f"{site}/{repository}"),
            ("Make a token of the kind Read, and copy it", f"{site}/settings/tokens"),
            ("Paste it into Access Token, and press Download again", "")]


def unusable(target: str, error: OSError, kept: str = KEPT) -> Explained:
    """`kept` says what remains of a download for which the disk is too full."""
    reason = f"the disk is full ({kept})" if error.errno == errno.ENOSPC else REASONS.get(error.errno, error.strerror)
    return Explained(f"the folder {target} cannot be used: {reason}")


def main() -> int:
    request = json.loads(sys.stdin.readline())
    channel, sys.stdout = sys.stdout, sys.stderr  # libraries must not print into the messages

    def tell(**message) -> None:
        print(json.dumps(message), file=channel, flush=True)

    try:
        with explaining(request["target"], request):
            run(request, tell)
    except Exception as error:
        tell(error=str(error) or type(error).__name__, status=getattr(error, "status", None),
             steps=getattr(error, "steps", ()))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
