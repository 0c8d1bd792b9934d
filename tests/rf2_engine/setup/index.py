# SPDX-License-Identifier: GPL-3.0-or-later
"""A package index on 127.0.0.1 that serves tiny wheels, and stops in the middle of a file when it is told to."""
import base64
import hashlib
import io
import threading
import zipfile
from http.server import BaseHTTPRequestHandler
from urllib.parse import unquote, urlsplit

from tests.rf2_engine.setup.local_server import LocalServer

TAG = "py3-none-any"
NAMES = {"tiny_one": "tiny-one", "tiny_two": "tiny-two"}  # as packages.PACKAGES


def wheel(name: str, version: str = "1.0", payload: int = 200_000) -> bytes:
    """A wheel whose package has an __init__.py with `value`, a large file and a shared namespace."""
    module = name.replace("-", "_")
    info = f"{module}-{version}.dist-info"
    files = {f"{module}/__init__.py": f'value = "{name} {version}"\n', f"{module}/data.bin": "x" * payload,
             f"shared_space/{module}.py": "", f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\n"
             f"Version: {version}\nRequires-Dist: numpy\n",
             f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: {TAG}\n"}
    files[f"{info}/RECORD"] = "".join(
        f"{path},sha256={base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b'=').decode()},"
        f"{len(text)}\n" for path, text in files.items()) + f"{info}/RECORD,,\n"
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for path, text in files.items():
            archive.writestr(zipfile.ZipInfo(path), text)
    return packed.getvalue()


class Index(LocalServer):
    """`wheels` is {(name, version): bytes}; `requests` lists the paths that were asked for."""

    def __init__(self, **versions: str):
        self.wheels = {(name.replace("_", "-"), version): wheel(name.replace("_", "-"), version)
                       for name, version in versions.items()}
        self.requests, self.stalling = [], ""  # a name: its wheel stops in the middle
        self.stalled = threading.Event()
        super().__init__(_Handler)

    @property
    def address(self) -> str:
        return f"{self.endpoint}/simple"

    def pins(self) -> dict:
        """As wheels.json, with the hashes of what is served now; every package needs only itself."""
        return {"needs": {name: [name] for name, _ in self.wheels},
                "wheels": {name: {"version": version, "files": {TAG: {
                    "sha256": hashlib.sha256(content).hexdigest(), "download": len(content),
                    "unpacked": len(content)}}} for (name, version), content in self.wheels.items()}}

    def downloads(self) -> list[str]:
        return [path.rpartition("/")[2].partition("-")[0] for path in self.requests if path.endswith(".whl")]


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        index, path = self.server, unquote(urlsplit(self.path).path)
        index.requests.append(self.path)
        for (name, version), content in index.wheels.items():
            file = f"{name.replace('-', '_')}-{version}-{TAG}.whl"
            if path == f"/simple/{name}/":
                return self._answer(f'<a href="/files/{file}">{file}</a>'.encode(), "text/html")
            if path == f"/files/{file}":
                return self._answer(content, "application/zip", stalls=index.stalling == name)
        self.send_error(404)

    def _answer(self, body: bytes, kind: str, stalls: bool = False):
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if stalls:
            self.wfile.write(body[:len(body) // 2])
            self.wfile.flush()
            self.server.stalled.set()
            self.server.closing.wait(600)
            self.close_connection = True
        else:
            self.wfile.write(body)

    def log_message(self, *arguments):
        pass
