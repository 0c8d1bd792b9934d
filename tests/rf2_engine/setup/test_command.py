# SPDX-License-Identifier: GPL-3.0-or-later
"""Set-up without a window: what `blender --command renderformer_v2` installs, says and ends with."""
import json
import os
import platform
import subprocess
import sys
import textwrap
from pathlib import Path

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.model.published.bundle_files import COMPONENTS, INDEX
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import (
    command,
    distributions,
    extension,
    packages,
    published_weights,
)

from tests.rf2_engine.setup.index import NAMES
from tools.extension import ROOT


@pytest.fixture
def said(capsys):
    """Runs the command; its exit status, output and errors."""
    def run(*arguments) -> tuple[int, str, str]:
        code = command.run([str(argument) for argument in arguments])
        return code, *capsys.readouterr()
    return run


@pytest.fixture
def real_folder():
    """packages.folder, before `target` puts another in its place: ask for it first."""
    return packages.folder


@pytest.fixture
def bundle(tmp_path):
    """A folder with all file names of the published weights."""
    folder = tmp_path / "shared" / "renderformer-v2"
    for name, configs in (COMPONENTS | {"vae": ("config.json",)}).items():
        (folder / name).mkdir(parents=True)
        (folder / name / configs[0]).write_text("{}")
        (folder / name / "model.safetensors").write_text("")
    (folder / "vae" / "diffusion_pytorch_model.safetensors").write_text("")
    (folder / INDEX).write_text("{}")
    return folder


def test_what_is_missing_is_installed_into_a_shared_folder(said, real_folder, index, target, monkeypatch, tmp_path):
    shared = tmp_path / "for all machines"
    monkeypatch.setattr(packages, "folder", real_folder)
    monkeypatch.setenv(packages.PACKAGES_VARIABLE, str(shared))
    code, _, errors = said("install")
    assert code == 0, errors
    assert distributions.find_intact(shared) == {"tiny-one": "1.0", "tiny-two": "2.0"} and not target.exists()
    assert not packages.missing(NAMES) and packages.elsewhere("tiny_one") is None


def test_the_build_is_kept_for_later(said, index, target):
    kept = extension.preferences()
    try:
        assert said("install", "--build", "cuda")[0] == 0
        assert kept.torch_build == "CUDA"
    finally:
        kept.torch_build = "AUTO"
    assert distributions.find_intact(target) == {"tiny-one": "1.0", "tiny-two": "2.0"}


def test_installing_again_downloads_nothing(said, index, target):
    code, output, _ = said("install")
    assert code == 0 and "installing 2 packages" in output and output.splitlines()[-1] == "RenderFormer-V2: ready"
    index.requests.clear()
    code, output, _ = said("install")
    assert code == 0 and output == "RenderFormer-V2: ready\n" and not index.requests


def test_without_permission_nothing_is_downloaded(said, index, target):
    bpy.context.preferences.system.use_online_access = False
    code, _, errors = said("install")
    assert code == 1 and "--online-mode" in errors and not index.requests


def test_an_installation_that_fails_says_why(said, index, target):
    index.wheels.pop(("tiny-two", "2.0"))
    code, _, errors = said("install")
    assert code == 1 and "tiny-two 2.0 could not be installed" in errors and len(errors.splitlines()[-1]) > 40


def test_weights_in_a_folder_are_chosen_when_they_are_complete(said, index, target, bundle):
    kept = extension.preferences()
    try:
        assert said("install", "--weights", bundle)[0] == 0
        assert published_weights.require() == bundle
        kept.weights_folder = ""
        (bundle / "metallic_mapper" / "model.safetensors").unlink()
        code, _, errors = said("install", "--weights", bundle)
        assert code == 1 and "metallic_mapper" in errors and kept.weights_folder == ""
    finally:
        kept.weights_folder = ""


@pytest.mark.parametrize("arguments", [[], ["uninstall"], ["install", "--build", "rocm"],
                                       ["install", "--weights", "x", "--download"]])
def test_wrong_arguments_are_explained(said, scene, arguments):
    code, output, errors = said(*arguments)
    assert code == 2 and not output and "blender --command renderformer_v2" in errors


def test_help_is_no_error(said, scene):
    code, output, _ = said("--help")
    assert code == 0 and "install" in output and "status" in output


def test_status_is_one_line_about_this_computer(said, scene):
    code, output, _ = said("status")
    found = json.loads(output)
    assert code == 0 and found["ready"] and not found["problems"] and output.count("\n") == 1
    assert found["blender"] == bpy.app.version_string and found["python"] == platform.python_version()
    assert found["device"] in ("cpu", "cuda", "mps") and found["weights"] == "rf2_small"
    import torch
    assert torch.__version__.startswith(found["packages"]["torch"]) and not found["missing"]


@pytest.mark.parametrize("weights", ["published", "/there/is/no/such/folder"])
def test_status_names_the_weights_that_are_missing(said, scene, weights):
    code, output, _ = said("status", "--weights", weights)
    (problem,) = json.loads(output)["problems"]
    said_of_it = f"no weights folder {Path('/there/is')}", "published weights are not complete"
    assert code == 1 and any(text in problem for text in said_of_it)


def test_status_names_packages_that_are_missing(said, scene, monkeypatch):
    monkeypatch.setattr(packages, "is_elsewhere", lambda name: name != "torch")
    code, output, _ = said("status")
    found = json.loads(output)
    assert "torch" not in found["packages"] and "safetensors" in found["packages"] and "torch" in found["missing"]
    assert code == 1 and "incomplete: torch." in found["problems"][0] and found["device"] == ""


@pytest.mark.parametrize("named", ["itself", "the folder that holds it"])
def test_shared_weights_come_before_own_ones_and_are_never_removed(scene, bundle, monkeypatch, named):
    monkeypatch.setenv(published_weights.WEIGHTS_VARIABLE, str(bundle if named == "itself" else bundle.parent))
    assert published_weights.require() == bundle
    assert published_weights.download_folder() == bundle.parent
    assert not bpy.ops.renderformer_v2.remove_weights.poll()


@pytest.mark.parametrize("named", ["missing", "empty"])
def test_a_variable_that_names_no_weights_is_said_with_its_name(said, scene, monkeypatch, tmp_path, named):
    folder = tmp_path / "weights" / "renderformer-v2"
    if named == "empty":
        folder.mkdir(parents=True)
    monkeypatch.setenv(published_weights.WEIGHTS_VARIABLE, str(folder.parent))
    code, output, _ = said("status", "--weights", "published")
    (problem,) = json.loads(output)["problems"]
    assert code == 1 and str(folder) in problem and "Preferences" not in problem
    assert f"{published_weights.WEIGHTS_VARIABLE} says where: correct it" in problem and "install --download" in problem


def test_a_variable_that_names_no_packages_is_said_with_its_name(said, scene, monkeypatch, tmp_path):
    monkeypatch.setenv(packages.PACKAGES_VARIABLE, str(tmp_path / "shared"))
    monkeypatch.setattr(packages, "is_elsewhere", lambda name: name != "torch")
    code, output, _ = said("status")
    (problem,) = json.loads(output)["problems"]
    assert code == 1 and f"incomplete in {tmp_path / 'shared'}: torch." in problem
    assert f"{packages.PACKAGES_VARIABLE} names this folder: correct it" in problem
    assert "Render Properties" not in problem


def test_a_variable_that_names_a_file_is_said_and_nothing_is_downloaded(said, real_folder, index, target, monkeypatch,
                                                                        tmp_path):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setattr(packages, "folder", real_folder)
    monkeypatch.setenv(packages.PACKAGES_VARIABLE, str(tmp_path / "file"))
    code, _, errors = said("install")
    assert code == 1 and f"{tmp_path / 'file'} cannot be used: a file is where a folder should be" in errors
    assert not [path for path in index.requests if path.startswith("/files/")]


def test_the_command_is_there_once_after_the_add_on_was_disabled_and_enabled():
    """Two registrations of one name make Blender refuse both, so taking back and registering again must leave one."""
    program = textwrap.dedent("""
        import os, sys
        sys.path.insert(0, sys.argv[1])
        from tools import extension
        package = extension.load()
        package.register()
        package.unregister()
        package.register()
        from renderformer_v2.rf2_engine.setup import command
        status = command.run(["status"])
        sys.stdout.flush()
        os._exit(status)
    """)
    done = subprocess.run([sys.executable, "-c", program, str(ROOT)], capture_output=True, text=True, timeout=600,
                          env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"})
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["ready"] and "already registered" not in done.stderr + done.stdout
