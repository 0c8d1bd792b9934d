# SPDX-License-Identifier: GPL-3.0-or-later
"""A Hugging Face Hub on 127.0.0.1 that serves two tiny repositories, and misbehaves when it is told to."""
import hashlib
import json
import random
from http.server import BaseHTTPRequestHandler

from tests.rf2_engine.setup.local_server import LocalServer

BUNDLE, VAE = "RenderFormer/renderformer-v2", "Qwen/Qwen-Image"
LARGE = "transformer_512/model.safetensors"  # large enough to break off in the middle
REVISION = "5" * 40
TRAINED = "75e0b4be04f60ec59a75f475837eced720f823b6"  # of the VAE, docs/scene-input.md 4.5
MAPPERS = ("diffspec_mapper", "metallic_mapper", "metallic_transmission_mapper")


def _bundle() -> dict[str, bytes]:
    files = {"model_index.json": b"{}",
             LARGE: random.Random(0).randbytes(400_000), "transformer_512/config.yaml": b"a: 1",
             "transformer_2048/model.safetensors": b"2048", "transformer_2048/config.yaml": b"b: 1",
             "material_autoencoder/preprocessor_config.json": b"{}"}
    for name in ("material_autoencoder", *MAPPERS):
        files |= {f"{name}/config.json": b"{}", f"{name}/model.safetensors": name.encode()}
    unwanted = {"README.md": b"#", "transformer_512/optimizer.pt": b"pickle", "other/model.safetensors": b"other"}
    return files | unwanted


class Hub(LocalServer):
    """`requests` is [(path, Range, Authorization)]; see _Handler for what the other attributes do."""

    def __init__(self):
        vae = {"vae/config.json": b"{}", "vae/diffusion_pytorch_model.safetensors": b"vae"}
        self.files = {BUNDLE: _bundle(), VAE: vae | {"transformer/config.json": b"{}"}}
        self.requests, self.token, self.gate = [], "", "/"
        self.cut, self.stalls, self.damaged = False, 0, False
        self.portal, self.whole, self.claimed = "", False, 0
        super().__init__(_Handler)

    def ranges(self) -> list[str | None]:
        """The Range headers of all requests for LARGE."""
        return [header for path, header, _ in self.requests if path.endswith(LARGE)]


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        hub, path = self.server, self.path.partition("?")[0]
        hub.requests.append((path, self.headers["Range"], self.headers["Authorization"]))
        if hub.portal and hub.portal in path:  # a network that shows its login page instead
            return self._answer(200, b"<html>Log in</html>" * 50)
        if hub.token and hub.gate in path and self.headers["Authorization"] != f"Bearer {hub.token}":
            return self._answer(401, b"{}")
        for repository, files in hub.files.items():
            revisions = (REVISION, TRAINED) if repository == VAE else (REVISION,)
            if path in (f"/api/models/{repository}", *(f"/api/models/{repository}/revision/{r}" for r in revisions)):
                return self._answer(200, _listing(repository, files, hub.claimed))
            name = path.removeprefix(f"/{repository}/resolve/{REVISION}/")
            if name in files:
                return self._file(name, files[name])
        self._answer(404, b"{}")

    def _file(self, name: str, content: bytes):
        if name != LARGE:
            return self._answer(200, content)
        if self.server.damaged:
            content = bytes(len(content))
        start = 0 if self.server.whole else int((self.headers["Range"] or "bytes=0-")[len("bytes="):-1])
        if self.server.cut and start:  # gone after it broke off
            return self._answer(503, b"")
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(content) - start))
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        self.end_headers()
        if not (self.server.cut or self.server.stalls):
            return self.wfile.write(content[start:])
        self.wfile.write(content[start:start + 200_000])
        self.wfile.flush()
        if self.server.stalls:
            self.server.stalls -= 1
            self.server.closing.wait(600)
        self.close_connection = True

    def _answer(self, status: int, body: bytes):
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments):
        pass


def _listing(repository: str, files: dict[str, bytes], claimed: int) -> bytes:
    siblings = []
    for name, content in files.items():
        entry = {"rfilename": name, "size": max(len(content), claimed),
                 "blobId": hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()}
        if name.endswith(".safetensors"):
            entry |= {"blobId": "9" * 40, "lfs": {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content),
                                                  "pointerSize": 134}}
        siblings.append(entry)
    return json.dumps({"id": repository, "sha": REVISION, "siblings": siblings}).encode()
