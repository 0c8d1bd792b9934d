# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's tables: what their commands compute, and that they go on from what is there."""
import json

import numpy as np
import OpenEXR
import pytest
import torch
import yaml
from safetensors.torch import load_file
from skimage.io import imread

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder, inverse_log10_1p
from renderformer_v2.model.material.mappers import load_material_mapper
from renderformer_v2.model.published.bundle import load_transformer
from renderformer_v2.model.weights.checkpoint import load_component
from renderformer_v2.model.weights.presets import WEIGHTS, weights_folder
from tests.model.published.bundles import tiny_published_config, write_bundle
from tools import ablation
from tools.benchmark.__main__ import TABLE, parse_arguments
from tools.benchmark.points import append_row, list_points
from tools.paper import latents, measured, runtime, scenes, triangles


def test_seconds_are_those_of_the_benchmark_beside_the_papers(tmp_path, capsys):
    arguments = ["-o", str(tmp_path), "--triangles", "1638", "--resolutions", "512,1024", "--presets", "rf2_200m"]
    for point in list_points(parse_arguments(arguments)):
        append_row(tmp_path / TABLE, point | {"precision_asked": point["precision"], "seconds": 1 + point["samples"]})
    runtime.main(arguments)
    assert "| 65536, 1024 | 1.00 s |" in capsys.readouterr().out
    assert json.loads((tmp_path / "runtime.json").read_text())["failed"] == []
    assert imread(tmp_path / "runtime.png").std() > 10
    by_triangles, by_pixels = runtime.PAPER["RF-V2"]
    assert len(by_triangles) == len(runtime.TRIANGLES) and len(by_pixels) == len(runtime.RESOLUTIONS)


def test_components_are_the_directions_of_largest_variance():
    random = np.random.default_rng(0)
    rows = random.normal(size=(500, 3)) * (1, 5, 0.1) + 7
    places, shares = latents.principal_components(rows)
    assert abs(np.corrcoef(places[:, 0], rows[:, 1])[0, 1]) > 0.999 and np.isclose(shares.sum(), 1)
    np.testing.assert_allclose(shares, sorted(shares, reverse=True))
    np.testing.assert_allclose(places.var(axis=0) / places.var(), shares * 3, rtol=0.05)


def test_latents_of_the_bundled_mapper_and_of_a_bundles_three_are_drawn(tmp_path):
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    for folder, more in (("ours", []), ("published", ["--weights", str(bundle)])):
        latents.main(["-o", str(tmp_path / folder), "--materials", "50", *more])
        assert imread(tmp_path / folder / "latents.png").std() > 1
    shaders = json.loads((tmp_path / "published" / "latents.json").read_text())["shaders"]
    assert len(shaders) == 3
    materials = latents.draw_materials(latents.SHADERS["metallic_transmission_mapper"][1], 999,
                                       np.random.default_rng(0))
    assert materials.shape[1] == load_material_mapper().inputs
    assert np.isclose(np.median(materials[:, 4]), 0.1, rtol=0.3) and materials[:, 5].min() >= 1


def test_a_measured_sphere_becomes_a_latent_and_a_picture(tmp_path):
    autoencoder = load_component(MaterialAutoencoder, WEIGHTS / "material" / "material_autoencoder").eval()
    with torch.inference_mode():
        red = load_material_mapper()(torch.tensor([[0.8, 0.05, 0.05, 0, 0.4, 1.5, 0]]))
        sphere = np.ascontiguousarray(inverse_log10_1p(autoencoder.decode(red))[0].movedim(0, -1).numpy())
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": sphere}) as file:
        file.write(str(tmp_path / "red.exr"))
    measured.main([str(tmp_path / "red.exr"), "-o", str(tmp_path / "out")])
    latent, scores = np.load(tmp_path / "out" / "red.npy"), json.loads((tmp_path / "out" / "measured.json").read_text())
    assert latent.shape == (9,) and 0 < np.abs(latent).max() < 1 and scores["red"]["psnr"] > 20
    before, after = imread(tmp_path / "out" / "measured.png").reshape(2, 64, 64, 3)[:, 24:40, 24:40].mean((1, 2))
    assert before[0] > 1.3 * before[1] and after[0] > 1.3 * after[1]


def test_the_authors_scenes_are_found_by_their_names(tmp_path):
    for name in ("dragon", "bedroom"):
        (tmp_path / "scenes" / name / "frame").mkdir(parents=True)
        (tmp_path / "scenes" / name / "frame" / "scene_config.json").touch()
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "scene_config.json").touch()
    found = scenes.list_scenes([tmp_path / "scenes", tmp_path / "own", tmp_path / "v1.json"])
    assert list(found) == ["bedroom", "dragon", "own", "v1"] and found["dragon"].name == "frame"
    with pytest.raises(ValueError, match="holds no scene"):
        scenes.list_scenes([tmp_path / "own" / "nothing"])


def test_full_attention_has_the_same_weights(tmp_path):
    own = weights_folder("rf2_small")
    other = triangles.full_attention(own, tmp_path / "ours")
    described = [json.loads((folder / "config.json").read_text())["model_config"] for folder in (own, other)]
    assert described[1] == described[0] | {"dense": True} and described[0]["dense"] is False
    assert load_file(other / "model.safetensors").keys() == load_file(own / "model.safetensors").keys()
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    other = triangles.full_attention(bundle, tmp_path / "published")
    assert load_transformer(other / "transformer_512").config.dense
    assert "dense" not in yaml.safe_load((bundle / "transformer_512" / "config.yaml").read_text())["model_config"]


def test_a_table_of_the_ablation_has_the_papers_numbers_beside_ours(tmp_path):
    scores = {"psnr": 21.4, "ssim": 0.86, "structure": 0.2, "flip": 0.2, "hdr_flip": 0.3}
    head, _, full, other = ablation.write({"full": scores, "w/o SW": scores}, tmp_path / "ablation").splitlines()
    assert json.loads((tmp_path / "ablation.json").read_text())["full"] == scores
    assert "structure (for LPIPS)" in head and "| 28.25 | 0.8982 | 0.0997 | 0.4200 |" in full
    assert other.startswith("| w/o SW | 21.40 | 0.8600 | 0.2000 | 0.3000 | 26.92 |")
