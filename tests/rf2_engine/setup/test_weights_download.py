# SPDX-License-Identifier: GPL-3.0-or-later
"""Getting the published weights from a local server: what goes over the wire, and what lies on disk afterwards."""
import hashlib
import re
import shutil
import sys
import time

import bpy
import pytest

import addon_utils  # bpy puts it on the path
from bl_ext.user_default.renderformer_v2.model.errors import CheckpointError
from bl_ext.user_default.renderformer_v2.model.published.image_encoder import find_vae
from bl_ext.user_default.renderformer_v2.rf2_engine.preferences import preferences
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import display, published_weights, weights_download
from bl_ext.user_default.renderformer_v2.rf2_engine.setup.weights_download import Download

from tests.rf2_engine.installed import PACKAGE
from tests.rf2_engine.layout import Layout
from tests.rf2_engine.setup.hub import BUNDLE, LARGE, REVISION, TRAINED, VAE, Hub

WANTED = 13  # files: 11 of the bundle, 2 of the VAE


@pytest.fixture
def hub(monkeypatch):
    server = Hub()
    monkeypatch.setenv("HF_ENDPOINT", server.endpoint)
    monkeypatch.setenv("HF_HUB_DOWNLOAD_TIMEOUT", "1")
    monkeypatch.setenv("NO_PROXY", "*")
    yield server
    weights_download.current.forget()
    server.stop()


@pytest.fixture
def online(scene):
    """The add-on with its preferences, allowed to use the network; nothing is downloaded yet."""
    addon_utils.enable(PACKAGE, default_set=True)
    bpy.context.preferences.system.use_online_access = True
    yield scene
    if bpy.ops.renderformer_v2.remove_weights.poll():
        bpy.ops.renderformer_v2.remove_weights()
    bpy.context.preferences.system.use_online_access = False


def finished(download: Download) -> Download:
    """Waits for the sizes, then for the download."""
    download.wait()
    if download.state == "ready":
        download.fetch()
        download.wait()
    return download


def ready(target) -> Download:
    """Knows the sizes."""
    download = Download(target)
    download.wait()
    return download


def stalled(hub, target, patience=600) -> Download:
    """A download in the middle of LARGE, for which no more data come; after `patience` seconds it asks again."""
    hub.stalls = 100
    download = ready(target)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_DOWNLOAD_TIMEOUT", str(patience))
        download.fetch()
    while not (hub.ranges() and unfinished(target)) and download.is_running:
        time.sleep(0.05)
    return download


def files(folder):
    """Sizes of all files but the empty one that locks the folder."""
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in folder.rglob("*")
            if path.is_file() and path.name != ".lock"}


def unfinished(folder) -> int:
    """Bytes of LARGE that have arrived."""
    return sum(size for name, size in files(folder).items() if LARGE in name and name.endswith(".part"))


def test_sizes_come_first_then_a_complete_bundle_that_a_scene_can_choose(hub, online):
    settings = online.renderformer_v2
    settings.weights_source = "PUBLISHED"
    with pytest.raises(CheckpointError, match="Preferences"):
        settings.weights()

    assert bpy.ops.renderformer_v2.download_weights() == {"FINISHED"}
    folder, total = published_weights.download_folder(), weights_download.current.process.total
    assert not files(folder) and not any("/resolve/" in path for path, _, _ in hub.requests)

    assert bpy.ops.renderformer_v2.fetch_weights() == {"FINISHED"}
    found = files(folder)
    assert len(found) == WANTED - 2 and sum(found.values()) == total  # one network is enough
    assert {name.rpartition(".")[2] for name in found} == {"json", "yaml", "safetensors"}
    assert (folder / "renderformer-v2" / LARGE).read_bytes() == hub.files[BUNDLE][LARGE]
    bundle = published_weights.bundle_folder()
    assert settings.weights() == str(bundle) and find_vae(bundle) == folder / "Qwen-Image" / "vae"
    assert not any(token for _, _, token in hub.requests)

    (bundle / "transformer_512/config.yaml").write_bytes(b"a: 2")  # of the same length
    (bundle / "metallic_mapper/model.safetensors").unlink()
    with pytest.raises(CheckpointError, match="metallic_mapper"):
        settings.weights()
    again = Download(folder, transformers=("transformer_512",))
    again.wait()
    assert again.total - again.present == len(b"a: 2") + len(b"metallic_mapper")

    assert bpy.ops.renderformer_v2.remove_weights() == {"FINISHED"}
    assert not folder.exists()


@pytest.mark.parametrize("networks, expected", [("SMALL", {"transformer_512"}), ("LARGE", {"transformer_2048"}),
                                                ("BOTH", {"transformer_512", "transformer_2048"})])
def test_the_chosen_networks_are_downloaded_and_nothing_that_no_render_needs(hub, online, networks, expected):
    kept = bpy.context.preferences.addons[PACKAGE].preferences
    kept.networks = networks
    assert bpy.ops.renderformer_v2.download_weights() == {"FINISHED"}
    assert bpy.ops.renderformer_v2.fetch_weights() == {"FINISHED"}
    kept.networks = "SMALL"
    folder = published_weights.bundle_folder()
    mappers = {"diffspec_mapper", "metallic_mapper", "metallic_transmission_mapper"}
    assert {path.name for path in folder.iterdir() if path.is_dir()} == expected | mappers
    assert not published_weights.missing_parts(folder)


def test_goes_on_after_a_stall(hub, tmp_path):
    hub.stalls = 1
    download = finished(Download(tmp_path))
    assert download.state == "done", download.error
    first, second = hub.ranges()
    assert first is None and 0 < int(second[len("bytes="):-1]) <= 200_000
    assert (tmp_path / "renderformer-v2" / LARGE).read_bytes() == hub.files[BUNDLE][LARGE]


def test_goes_on_where_an_earlier_download_broke_off(hub, tmp_path):
    hub.cut = True
    download = finished(Download(tmp_path))
    assert download.state == "failed" and "kept" in download.error
    assert not (tmp_path / "renderformer-v2" / LARGE).exists()
    kept = unfinished(tmp_path)
    hub.cut = False
    download = finished(Download(tmp_path))
    assert download.state == "done" and hub.ranges()[-1] == f"bytes={kept}-" and kept > 0
    assert (tmp_path / "renderformer-v2" / LARGE).read_bytes() == hub.files[BUNDLE][LARGE]
    assert len(files(tmp_path)) == WANTED


@pytest.fixture
def pinned(hub, monkeypatch):
    """The bundle's entry of REPOSITORIES, of a known revision and with the hash of LARGE."""
    entry = published_weights.REPOSITORIES[0]
    monkeypatch.setitem(entry, "revision", REVISION)
    monkeypatch.setitem(entry, "sha256", {LARGE: hashlib.sha256(hub.files[BUNDLE][LARGE]).hexdigest()})
    return entry


def test_a_pinned_revision_is_asked_for(hub, pinned, tmp_path):
    assert finished(Download(tmp_path)).state == "done"
    listings = {path for path, _, _ in hub.requests if path.startswith("/api/models/")}
    assert listings == {f"/api/models/{BUNDLE}/revision/{REVISION}", f"/api/models/{VAE}/revision/{TRAINED}"}
    pinned["revision"] = "6" * 40
    download = finished(Download(tmp_path))
    assert download.state == "failed" and f"{BUNDLE} was not found" in download.error


@pytest.mark.parametrize("sha256, message", [
    ({LARGE: "0" * 64}, f"{LARGE} is not the file that this add-on knows"),
    ({"transformer_512/lost.safetensors": "0" * 64}, "does not hold the expected files"),
    ({"transformer_512/config.yaml": "0" * 64}, "config.yaml arrived damaged"),
], ids=["another hash", "a file that is not there", "another content"])
def test_a_file_that_has_not_the_known_hash_is_refused(hub, pinned, tmp_path, sha256, message):
    pinned["sha256"] = sha256
    download = finished(Download(tmp_path))
    assert download.state == "failed" and message in download.error
    assert not (tmp_path / "renderformer-v2" / "transformer_512" / "config.yaml").exists()


def test_cancelling_waits_for_no_data_and_leaves_no_unfinished_file_under_its_name(hub, tmp_path):
    download = stalled(hub, tmp_path)
    asked = len(hub.ranges())
    download.cancel()
    assert download.state == "cancelled" and len(hub.ranges()) == asked  # it did not wait for data, and ask again
    assert not (tmp_path / "renderformer-v2" / LARGE).exists()


def test_damaged_content_is_thrown_away(hub, tmp_path):
    hub.damaged = True
    download = finished(Download(tmp_path))
    assert download.state == "failed" and "damaged" in download.error
    assert not any(LARGE in name for name in files(tmp_path))


def test_a_second_download_leaves_the_first_alone(hub, tmp_path):
    first = stalled(hub, tmp_path)
    second = finished(Download(tmp_path))
    assert second.state == "failed" and "another Blender" in second.error
    assert first.state == "fetching" and unfinished(tmp_path)
    first.cancel()
    hub.stalls = 0
    assert finished(Download(tmp_path)).state == "done"
    assert hub.ranges()[-1] is not None


@pytest.mark.parametrize("begun", [False, True])
def test_a_login_page_instead_of_a_file_spoils_nothing(hub, tmp_path, begun):
    if begun:
        stalled(hub, tmp_path).cancel()
        hub.stalls = 0
    kept = unfinished(tmp_path)
    hub.portal = LARGE
    download = finished(Download(tmp_path))
    assert download.state == "failed" and "login" in download.error and "force_download" not in download.error
    assert unfinished(tmp_path) == kept and bool(kept) == begun
    hub.portal = ""
    assert finished(Download(tmp_path)).state == "done"
    assert hub.ranges()[-1] == (f"bytes={kept}-" if begun else None)


def test_a_login_page_instead_of_the_sizes_is_named(hub, tmp_path):
    hub.portal = "/api/models/"
    download = ready(tmp_path)
    assert download.state == "failed" and "login" in download.error and not download.needs_token


def test_a_server_that_cannot_go_on_may_send_all_again(hub, tmp_path):
    stalled(hub, tmp_path).cancel()
    hub.stalls, hub.whole = 0, True
    assert finished(Download(tmp_path)).state == "done"
    assert (tmp_path / "renderformer-v2" / LARGE).read_bytes() == hub.files[BUNDLE][LARGE]


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_what_could_be_written_is_kept(hub, tmp_path):
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (399_000, limits[1]))  # in the middle of a write
    try:
        download = finished(Download(tmp_path))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert download.state == "failed" and str(tmp_path) in download.error and "Errno" not in download.error
    assert unfinished(tmp_path) == 399_000
    assert finished(Download(tmp_path)).state == "done" and hub.ranges()[-1] == "bytes=399000-"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /dev/full")
def test_a_full_disk_is_said_with_the_folder(hub, tmp_path):
    stalled(hub, tmp_path).cancel()
    hub.stalls = 0
    part, = tmp_path.rglob("*.part")
    part.unlink()
    part.symlink_to("/dev/full")
    download = finished(Download(tmp_path))
    assert download.state == "failed" and "kept" in download.error
    assert f"{tmp_path} cannot be used: the disk is full" in download.error


def test_too_little_space_is_known_before(hub, tmp_path):
    hub.claimed = 1 << 55
    download = finished(Download(tmp_path))
    assert download.state == "failed" and str(tmp_path) in download.error and not files(tmp_path)
    assert re.search(r"\d+\.\d MB are needed, \d+\.\d MB are free", download.error)


def test_a_folder_that_disappears_or_is_none_is_named(hub, tmp_path):
    folder = tmp_path / "weights"
    download = stalled(hub, folder, patience=1)
    shutil.rmtree(folder)
    hub.stalls = 0  # the connection breaks after a second without data, and the rest comes
    download.wait()
    assert download.state == "failed" and f"{folder} cannot be used: it was removed" in download.error
    folder.write_bytes(b"")
    download = finished(Download(folder))
    assert download.state == "failed" and f"{folder} cannot be used: a file" in download.error


@pytest.mark.parametrize("gate", ["/api/models/", "/resolve/"], ids=["private", "gated files"])
def test_a_token_is_asked_for_only_when_the_repository_wants_one(hub, tmp_path, gate):
    hub.token, hub.gate = "hf_secret", gate
    download = finished(Download(tmp_path))
    assert download.state == "failed" and download.needs_token and "access token" in download.error
    refused = finished(Download(tmp_path, "hf_wrong"))
    assert refused.needs_token and "refuses" in refused.error and "hf_wrong" not in refused.error
    assert finished(Download(tmp_path, "hf_secret")).state == "done"


def test_the_way_to_a_repository_that_is_not_open_is_shown_step_by_step(hub, online):
    hub.token, hub.gate = "hf_secret", f"/api/models/{BUNDLE}"
    steps = rf"asks for an access token .*1\. Log in.*2\..*{BUNDLE}.*3\..*/settings/tokens"
    with pytest.raises(RuntimeError, match=steps):
        bpy.ops.renderformer_v2.download_weights()
    drawn = Layout()
    preferences._draw_download(drawn, bpy.context.preferences.addons[PACKAGE].preferences)
    pages = [it.url for it in drawn.operators if hasattr(it, "url")]
    assert pages == [f"{hub.endpoint}/{page}" for page in ("login", BUNDLE, "settings/tokens")]
    assert "access_token" in drawn.shown and any(text.startswith("4. Paste it") for text in drawn.texts)
    bpy.context.preferences.addons[PACKAGE].preferences.access_token = "hf_secret"
    assert bpy.ops.renderformer_v2.download_weights() == {"FINISHED"}
    assert weights_download.current.process.state == "ready"
    bpy.context.preferences.addons[PACKAGE].preferences.access_token = ""


@pytest.mark.parametrize("token", ["hf_\u00e9", "hf_a b\nX"])
def test_a_token_with_a_wrong_character_can_be_corrected(hub, tmp_path, token):
    download = finished(Download(tmp_path, token))
    assert download.state == "failed" and download.needs_token and "access token" in download.error
    assert token.splitlines()[-1] not in download.error and not hub.requests


def test_a_repository_that_is_not_there_is_named(hub, tmp_path):
    del hub.files[BUNDLE]
    download = finished(Download(tmp_path))
    assert download.state == "failed" and BUNDLE in download.error and not download.needs_token


def test_a_server_that_is_not_there_is_said_in_one_line(hub, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    download = finished(Download(tmp_path))
    assert download.state == "failed" and "connection" in download.error and "\n" not in download.error


def test_without_online_access_nothing_is_asked(hub, online):
    bpy.context.preferences.system.use_online_access = False
    with pytest.raises(RuntimeError, match="Allow Online Access"):
        bpy.ops.renderformer_v2.download_weights()
    with pytest.raises(RuntimeError, match="Allow Online Access"):
        bpy.ops.renderformer_v2.install_packages()
    assert not hub.requests and weights_download.current.process is None


def test_the_token_is_not_stored_in_the_preferences(online):
    kept = bpy.context.preferences.addons[PACKAGE].preferences
    kept.access_token = " hf_sec\nret "
    assert preferences.session.token == "hf_secret"
    stored = kept.bl_system_properties_get() if bpy.app.version >= (5, 0, 0) else kept
    assert "access_token" not in (stored.keys() if stored else ())
    kept.access_token = ""


def test_the_progress_goes_on_after_opening_a_file(online, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    display.keep_redrawing()
    for load in (bpy.ops.wm.read_homefile, lambda: bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))):
        load()
        assert bpy.app.timers.is_registered(display.redraw)
    bpy.app.timers.unregister(display.redraw)


def test_a_folder_of_the_user_comes_before_the_download(online, tmp_path):
    online.renderformer_v2.weights_source = "PUBLISHED"
    bpy.context.preferences.addons[PACKAGE].preferences.weights_folder = str(tmp_path / "mine")
    with pytest.raises(CheckpointError, match="choose a folder"):
        online.renderformer_v2.weights()
    assert published_weights.bundle_folder() == tmp_path / "mine"
    bpy.context.preferences.addons[PACKAGE].preferences.weights_folder = ""
