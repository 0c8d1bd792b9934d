# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.measured`: a measured BRDF becomes the sphere that Cycles renders of it, and a latent."""
import sys

import numpy as np
import pytest
from skimage.io import imread

from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.material.measured import SHAPE, MeasuredBRDF, sphere_picture
from tests.model.material.test_adaptive_brdf import COLOR as METAL
from tests.model.material.test_adaptive_brdf import tensors, write_tensors
from tools import measured
from tools.datagen import spheres

COLOR = 0.2, 0.5, 0.8


@pytest.fixture
def lambertian(tmp_path):
    """A file of a matt BRDF."""
    MeasuredBRDF(np.broadcast_to(np.float32(COLOR) / np.pi, (*SHAPE, 3))).save(tmp_path / "matt.binary")
    return tmp_path / "matt.binary"


@pytest.mark.slow
def test_a_matt_brdf_is_the_sphere_that_cycles_renders(lambertian, tmp_path):
    panorama = measured.studio_light()
    ours = sphere_picture(MeasuredBRDF.load(lambertian), panorama, spheres.SIZE)
    tree = spheres.build_scene(samples=64)
    spheres.set_parameters(tree, "diffspec_mapper", np.array([*COLOR, 0, 0, 0, 1]))
    theirs = spheres.render(str(tmp_path / "sphere.exr")).astype(np.float32)
    assert np.abs(ours - theirs).mean() < 0.01 * theirs.max() and ours.std() > 0.05


def test_a_lobe_lies_where_the_half_vector_is_the_normal():
    table = np.zeros((*SHAPE, 3), np.float32)
    table[:9] = 1  # half vectors within 0.9 degrees of the normal
    brdf, normal = MeasuredBRDF(table), np.array([[0, 0, 1.0]])
    for angle in np.radians((5, 40, 80)):
        incoming, mirrored = (np.array([[sign * np.sin(angle), 0, np.cos(angle)]]) for sign in (1, -1))
        assert brdf(normal, incoming, mirrored).all() and not brdf(normal, incoming, -mirrored).any()
        aside = np.array([[-np.sin(angle + 0.1), 0, np.cos(angle + 0.1)]])
        assert not brdf(normal, incoming, aside).any()


def test_the_command_writes_nine_numbers_that_the_autoencoder_shows_as_the_sphere(lambertian, tmp_path, monkeypatch,
                                                                                  capsys):
    monkeypatch.setattr(sys, "argv", ["measured", str(lambertian), "-o", str(tmp_path / "latent.npy")])
    assert measured.main() == 0
    latent = np.load(tmp_path / "latent.npy")
    assert latent.shape == (9,) and np.abs(latent).max() < 1 and len(capsys.readouterr().out.split()) == 9
    sphere, decoded = np.split(imread(tmp_path / "latent.png")[..., :3].astype(np.float32) / 255, 2, axis=1)
    assert np.abs(decoded - sphere).mean() < 0.2 * sphere.mean() and sphere.std() > 0.1


@pytest.mark.slow
def test_so_does_a_file_of_the_rgl_database(tmp_path, monkeypatch):
    (tmp_path / "metal_rgb.bsdf").write_bytes(write_tensors(tensors()))
    monkeypatch.setattr(sys, "argv", ["measured", str(tmp_path / "metal_rgb.bsdf"), "-o", str(tmp_path / "latent.npy")])
    assert measured.main() == 0 and np.load(tmp_path / "latent.npy").shape == (9,)
    sphere = np.split(imread(tmp_path / "latent.png")[..., :3].astype(np.float32) / 255, 2, axis=1)[0]
    red, green, blue = (sphere ** 2.2).mean((0, 1))
    assert red / blue == pytest.approx(METAL[0] / METAL[2], rel=0.2) and red < green < blue and sphere.std() > 0.1


@pytest.mark.parametrize("content", [b"", b"junk" * 100])
def test_what_is_no_brdf_is_named(tmp_path, content):
    (tmp_path / "x.binary").write_bytes(content)
    with pytest.raises(SceneError, match="x.binary is no binary file of the MERL"):
        MeasuredBRDF.load(tmp_path / "x.binary")
