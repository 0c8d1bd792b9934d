# SPDX-License-Identifier: GPL-3.0-or-later
"""BRDFs of the RGL material database: their files, and reflectance looked up by the distribution of visible normals."""
import struct

import numpy as np
import pytest

from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.geometry import unit
from renderformer_v2.model.material.adaptive_brdf import MAGIC, TABLES, TYPES, AdaptiveBRDF, read_tensors

COLOR = np.array((0.2, 0.5, 0.8))
ALPHA = 0.4
NORMAL = np.array([[0.0, 0.0, 1.0]])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def density(cosine):
    """Of normals, GGX."""
    return ALPHA ** 2 / (np.pi * (cosine ** 2 * (ALPHA ** 2 - 1) + 1) ** 2)


def seen_area(cosine):
    """Of the same microfacets from an elevation (Smith)."""
    return (cosine + np.sqrt(ALPHA ** 2 + (1 - ALPHA ** 2) * cosine ** 2)) / 2


def tensors(size=65, visible=None) -> dict[str, np.ndarray]:
    """Microfacets that mirror COLOR and never hide each other, whatever the distribution that the tables go by."""
    cosine = np.cos(np.linspace(0, 1, size) ** 2 * np.pi / 2)
    elevations = np.linspace(0, 1.5, 8)
    visible = np.ones((8, 9, 9)) if visible is None else visible
    return {"description": np.frombuffer(b"made up", np.uint8), "phi_i": np.zeros(1, np.float32),
            "theta_i": elevations.astype(np.float32), "ndf": np.tile(density(cosine), (2, 1)).astype(np.float32),
            "sigma": np.tile(seen_area(cosine), (2, 1)).astype(np.float32), "vndf": visible[None].astype(np.float32),
            "rgb": np.broadcast_to(COLOR[None, None, :, None, None], (1, 8, 3, 5, 5)).astype(np.float32)}


def write_tensors(tensors: dict[str, np.ndarray]) -> bytes:
    """The inverse of `read_tensors`."""
    head, body = MAGIC + bytes((1, 0)) + struct.pack("<I", len(tensors)), b""
    start = len(head) + sum(13 + len(name.encode()) + 8 * x.ndim for name, x in tensors.items())
    for name, x in tensors.items():
        kind = TYPES.index(x.dtype.str[1:])
        head += struct.pack("<H", len(name.encode())) + name.encode()
        head += struct.pack(f"<HBQ{x.ndim}Q", x.ndim, kind, start + len(body), *x.shape)
        body += x.astype(x.dtype.newbyteorder("<")).tobytes()
    return head + body


def brdf_of(tensors) -> AdaptiveBRDF:
    return AdaptiveBRDF(*(tensors[name] for name in TABLES))


def directions(count: int, rng) -> np.ndarray:
    return unit(rng.normal(size=(count, 3)) * (1, 1, 0) + (0, 0, 1) * rng.uniform(0.2, 2, (count, 1)))


def test_a_file_is_read_as_it_was_written(tmp_path):
    written = tensors()
    (tmp_path / "x_rgb.bsdf").write_bytes(write_tensors(written))
    found = read_tensors((tmp_path / "x_rgb.bsdf").read_bytes())
    assert found.keys() == written.keys()
    for name, x in written.items():
        assert found[name].dtype == x.dtype
        np.testing.assert_array_equal(found[name], x)
    assert AdaptiveBRDF.load(tmp_path / "x_rgb.bsdf").color.shape == (1, 8, 3, 5, 5)


def test_microfacets_reflect_as_in_closed_form(rng):
    brdf = brdf_of(tensors())
    incoming, outgoing = directions(500, rng), directions(500, rng)
    normal = np.repeat(NORMAL, 500, 0)
    half = unit(incoming + outgoing)
    expected = density(half[:, 2]) / (4 * seen_area(outgoing[:, 2]) * incoming[:, 2])
    np.testing.assert_allclose(brdf(normal, incoming, outgoing), expected[:, None] * COLOR, rtol=0.02)
    assert not brdf(normal, incoming * (1, 1, -1), outgoing).any()


def test_an_isotropic_brdf_is_the_same_however_the_surface_is_turned(rng):
    colored = tensors()
    colored["rgb"] = rng.uniform(size=(1, 8, 3, 5, 5)).astype(np.float32)
    brdf = brdf_of(colored)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    vectors = np.repeat(NORMAL, 50, 0), directions(50, rng), directions(50, rng)
    np.testing.assert_allclose(brdf(*(v @ turn.T for v in vectors)), brdf(*vectors), rtol=1e-6)


def test_tables_are_looked_up_where_the_distribution_of_visible_normals_has_its_samples(rng):
    visible = rng.uniform(0.2, 2, (8, 9, 9))
    brdf = brdf_of(tensors(visible=visible))
    slices = brdf._slices(np.zeros(200), np.full(200, 0.3))
    place, step = rng.uniform(0.01, 0.99, (200, 2)), 1e-5
    ahead = [(brdf._distributed(place + step * np.eye(2)[axis], slices) - brdf._distributed(place, slices)) / step
             for axis in (0, 1)]
    stretch = np.linalg.det(np.stack(ahead, -1))  # of small squares is the density
    cell = np.floor(place * 8).astype(int)
    right, down = (place * 8 - cell).T
    share = 0.3 / (1.5 / 7) - 1
    table = sum(weight * x / ((x[1:, 1:] + x[:-1, 1:] + x[1:, :-1] + x[:-1, :-1]) / 4).mean()
                for weight, x in ((1 - share, visible[1]), (share, visible[2])))
    expected = sum(table[cell[:, 1] + i, cell[:, 0] + j] * (down if i else 1 - down) * (right if j else 1 - right)
                   for i in (0, 1) for j in (0, 1))
    np.testing.assert_allclose(stretch, expected, rtol=0.01)


@pytest.mark.parametrize("content, said", [
    (b"junk" * 100, "no file of the RGL material database"),
    (MAGIC + b"\1\0\5\0\0\0", "or damaged: download it again"),
    (write_tensors({"theta_i": np.zeros(3, np.float32)}), "it has no phi_i, ndf, sigma, vndf, rgb"),
    (write_tensors(tensors() | {"spectra": np.zeros(3, np.float32)}), "ends with _rgb.bsdf")])
def test_what_is_no_brdf_is_named(tmp_path, content, said):
    (tmp_path / "x.bsdf").write_bytes(content)
    with pytest.raises(SceneError, match=said):
        AdaptiveBRDF.load(tmp_path / "x.bsdf")
