# SPDX-License-Identifier: GPL-3.0-or-later
"""Golden fixtures: recompute everything that a case recorded, under the fixture's names (tests/fixtures/README.md)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from renderformer_v2.model.camera import square_view, view_rays
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.environment import direction_map, environment_images, rotate_environment, rotation_matrix
from renderformer_v2.model.material.autoencoder import MaterialAutoencoder, log10_1p
from renderformer_v2.model.material.mappers import MAPPERS
from renderformer_v2.model.network.inputs import NetworkInputs, ViewInputs, VolumeInputs
from renderformer_v2.model.network.layers import nerf_encode, store_in_precision
from renderformer_v2.model.network.renderformer import RenderFormer, store_with_exact_view, to_radiance
from renderformer_v2.model.network.sequence import centroids, hilbert_codes, hilbert_grid, hilbert_order
from renderformer_v2.model.published.model_config import model_config
from renderformer_v2.model.scene import barycentric_grid

from .cases import VOLUME_FIELDS, Case, Recorder, network_inputs, recipe_network, view_inputs, with_recipe_weights
from .texture_tiles import dequantise, quantise, sample_tiles


@torch.no_grad()
def network_results(case: Case) -> dict[str, torch.Tensor]:
    """Tokens, positions, every layer and the images; `dbg.*` and `alt.*` when the case has them."""
    network, inputs, views = recorded_call(case)
    config = network.config
    layers, view_layers = network.transformer.layers, network.view_transformer.transformer.layers
    scratch = network.view_transformer.out_dpt.scratch
    pyramid = {name: getattr(scratch, name) for name in
               ["output_conv1", *(f"layer{i}_rn" for i in range(1, 5)), *(f"refinenet{i}" for i in range(1, 5))]}
    with Recorder({
        **{f"layer{i}": layer for i, layer in enumerate(layers)},
        **{f"ray{i}": layer for i, layer in enumerate(view_layers)},
        **{f"cross{i}": layer.multihead_attn.out_proj for i, layer in enumerate(view_layers)},
        **{f"swin{i}": layer.self_attn for i, layer in enumerate(view_layers)},
        "attention": layers[0].multihead_attn.out_proj, "dpt": network.view_transformer.out_dpt,
    }) as record, inference(), team(1):  # several threads would record chunks in whatever order they finish
        sequence, _ = network.embed_scene(inputs)
        context = network.encode_scene(inputs)
        log_image = network.render_view(context, views)

    def rays(tokens: torch.Tensor) -> torch.Tensor:
        return tokens.reshape(len(views.origin), -1, config.view_transformer_latent_dim)

    results = order_results(case, inputs) | {
        "out.packed_tri_id": sequence.triangle, "out.pos_pre": sequence.position,
        "out.tokens_pre": sequence.embedding, "out.tokens_layer0": record["layer0"],
        "out.tokens_stage1": context.tokens,
        "out.ray_in": network.embed_rays(views),
        **{f"out.ray_layer{i}": rays(record[f"ray{i}"]) for i in range(len(view_layers))},
        "out.image_raw": record["dpt"], "out.log_image": log_image, "out.linear_image": to_radiance(log_image),
        "in.rays_d": camera_results(case),
    }
    if any(name.startswith("dbg.") for name in case.tensors):
        with Recorder(pyramid) as maps:  # outside of inference() the decoder computes whole maps of any size
            network.render_view(context, views)
        results |= embedding_results(network, case, inputs) | attention_results(network, sequence) | {
            "dbg.enc0_attn": record["attention"], "dbg.enc1": record["layer1"],
            "dbg.attn0": torch.cat(record.inputs["attention"]).unflatten(-1, (config.num_heads, -1)).transpose(0, 1),
            **{f"dbg.view{i}_cross": rays(record[f"cross{i}"]) for i in range(len(view_layers))},
            **{f"dbg.view{i}_swin": record[f"swin{i}"] for i in range(len(view_layers))},
            **{f"dbg.dpt_{name}": maps[name][:1] for name in pyramid},
        }
    if any(name.startswith("alt.") for name in case.tensors):
        results |= alternative_results(network, inputs, views)
    return results


def recorded_call(case: Case) -> tuple[RenderFormer, NetworkInputs, ViewInputs]:
    """The network of a case, and what it was called with."""
    config = replace(model_config(case.info["model_config"]),
                     embed_norm_eps=case.info["numerics"]["embed_norm_eps"])
    rays = {"in.rays_d": camera_results(case)}  # where they were not recorded
    return (recipe_network(config, case.info["weights"]["salt"]), network_inputs(case.tensors),
            view_inputs(rays | case.tensors))


@inference()
def precision_psnr(case: Case, dtype: torch.dtype, exact_view: bool = False) -> float:
    """dB between the log images with weights and products in `dtype` and in float32, with the latter's peak.

    exact_view: stage 2 as cards with TensorFloat-32 have it, which stays in float32 but for its cross-attention.
    """
    network, *call = recorded_call(case)
    exact = network(*call)
    error = (store_with_exact_view if exact_view else store_in_precision)(network, dtype)(*call) - exact
    return (20 * exact.abs().max().log10() - 10 * error.square().mean().log10()).item()


def order_results(case: Case, inputs: NetworkInputs) -> dict[str, torch.Tensor]:
    """Candidates of the sort in input order, their codes, and the order."""
    ids, positions = (~inputs.is_light).nonzero()[:, 0], centroids(inputs.triangles)[~inputs.is_light]
    if inputs.volumes is not None:
        rows = case.tensors["in.volume_mask"].nonzero()[:, 0]
        ids, positions = torch.cat([ids, len(inputs.light) + rows]), torch.cat([positions, inputs.volumes.position])
    return {"out.order_in": ids, "out.hilbert_code": hilbert_codes(hilbert_grid(positions)),
            "out.order": ids[hilbert_order(positions)], "in.light_encoded": inputs.light}


def camera_results(case: Case) -> torch.Tensor:
    """The ray maps from the recorded cameras: a crop of the square with the larger side."""
    camera, scene = case.info["camera"], case.info["scene"]
    crop = (*camera["crop_origin"], scene["height"], scene["width"])
    views = [square_view(c2w, fov, camera["source_res"], crop)
             for c2w, fov in zip(case.tensors["in.c2w"].numpy(), case.tensors["in.fov_deg"].numpy())]
    return torch.from_numpy(np.stack([view_rays(view)[1] for view in views]))


def embedding_results(network: RenderFormer, case: Case, inputs: NetworkInputs) -> dict[str, torch.Tensor]:
    """The parts of the triangle token, and volume tokens with the masked rows."""
    offsets = (inputs.triangles - centroids(inputs.triangles)[:, None]).flatten(1)
    lights, light_index = network.embed_light(inputs.light)
    results = {
        "dbg.nerf_pos": nerf_encode(offsets, network.config.vertex_pe_num_freqs),
        "dbg.emb_pos": network.embed_shape(inputs.triangles), "dbg.emb_vn": network.embed_normals(inputs.normals),
        "dbg.emb_tex": network.embed_textures(inputs.texture)[inputs.texture_index],
        "dbg.emb_light": lights[light_index],
    }
    if "in.volume_density" in case.tensors:
        cells = VolumeInputs(*(case.tensors[f"in.volume_{f}"] for f in VOLUME_FIELDS))
        results["dbg.emb_vol"] = network.volume_encoder(cells)
    return results


def attention_results(network: RenderFormer, sequence) -> dict[str, torch.Tensor]:
    """Queries, keys and values of the first layer, heads first."""
    layer = network.transformer.layers[0]
    rotation = network.transformer.rope_emb(sequence.position)
    x = layer.query_norm(sequence.embedding)
    parts = layer.multihead_attn.queries(x, rotation), *layer.multihead_attn.keys_values(x, rotation)
    return {f"dbg.{name}0": part.transpose(0, 1) for name, part in zip("qkv", parts)}


@inference()
def alternative_results(network: RenderFormer, inputs: NetworkInputs, views: ViewInputs) -> dict[str, torch.Tensor]:
    """The same weights with the CUDA epsilon, without the window, and without the environment."""
    def variant(**changes) -> RenderFormer:
        with torch.device("meta"):
            other = RenderFormer(replace(network.config, **changes))
        other.load_state_dict(network.state_dict(), assign=True)
        return other.requires_grad_(False).eval()

    cuda_eps, dense = variant(embed_norm_eps=1e-6), variant(dense=True)
    dark = replace(inputs, environment=None)
    return {
        "alt.tokens_pre_eps1e-6": cuda_eps.embed_scene(inputs)[0].embedding,
        "alt.log_image_eps1e-6": cuda_eps(inputs, views),
        "alt.log_image_dense": dense(inputs, views),
        "alt.log_image_noenv": network(dark, views),
        "alt.noenv_packed_tri_id": network.embed_scene(dark)[0].triangle,
    }


@torch.no_grad()
def material_results(case: Case) -> dict[str, torch.Tensor]:
    """Mappers, the byte round trip of latents, and the autoencoder when the case has it."""
    salt, stored = case.info["weights"]["salt"], quantise(case.tensors["in.latent_map"].numpy())
    results = {"out.latent_map_u8": torch.from_numpy(stored),
               "out.latent_map_back": torch.from_numpy(dequantise(stored))}
    for name, arguments in case.info["mapper_defaults"].items():
        mapper = with_recipe_weights(MAPPERS[name](**arguments), salt, f"{name}/")
        results[f"out.{name}"] = mapper(case.tensors[f"in.{name}"])
    return results | autoencoder_results(case, salt) if "autoencoder" in case.info else results


def autoencoder_results(case: Case, salt: int) -> dict[str, torch.Tensor]:
    """Latents of pictures with what leads to them, and one picture of a latent."""
    arguments = {k: v for k, v in case.info["autoencoder"].items() if k != "preprocessing"}
    with torch.device("meta"):
        autoencoder = MaterialAutoencoder(**arguments)
    with_recipe_weights(autoencoder, salt, "material_autoencoder/")
    with Recorder({"mid": autoencoder.encoder_mid, "final": autoencoder.encoder_final}) as record:
        latent = autoencoder.encode(log10_1p(case.tensors["in.ae_linear_rgb"].float()))
    decoded = autoencoder.decode(case.tensors["in.ae_latent_dec"])
    return {
        "out.ae_latent": latent, "out.ae_encoder_final": record["final"].flatten(1),
        "out.ae_encoder_mid_every4": record["mid"][:, ::16, ::4, ::4], "out.ae_decoded_every4": decoded[..., ::4, ::4],
        "out.ae_decoded_stats": torch.stack([decoded.mean(), decoded.std(correction=0), decoded.min(), decoded.max()]),
    }


def environment_results(case: Case) -> dict[str, torch.Tensor]:
    """Rotation, strength, LDR / HDR images, direction map and camera rays."""
    t = {name: tensor.numpy() for name, tensor in case.tensors.items()}
    maps = [rotate_environment(t["in.env_rgba" if i == 1 else "in.env"], degrees, strength)
            for i, (degrees, strength) in enumerate(zip(t["in.rotation_deg"], t["in.strength"]))]
    ldr, hdr, strength = environment_images(maps[1])
    cameras = list(zip(t["in.c2w"], t["in.fov_deg"]))
    full = [view_rays(square_view(*camera, 8)) for camera in cameras]
    crops = [view_rays(square_view(*camera, 40, (*origin, 8, 8)))[1]
             for camera, origin in zip(cameras, t["in.crop_origin_yx"].astype(int))]
    directions = direction_map(256, 512)
    results = {
        "out.rotation_matrix": np.stack([rotation_matrix(degrees) for degrees in t["in.rotation_deg"]]),
        "out.env_chw": np.stack([m.transpose(2, 0, 1) for m in maps]),
        "out.vae_input_ldr": ldr, "out.vae_input_hdr": hdr, "out.env_strength": np.array([strength]),
        "out.direction_map_small": direction_map(*t["in.env"].shape[:2]),
        "out.direction_map_256x512_every16": directions[::16, ::16],
        "out.direction_map_256x512_sum": directions.sum(axis=(0, 1), dtype=np.float64),
        "out.rays_o": np.stack([o for o, _ in full]), "out.rays_full_res8": np.stack([d for _, d in full]),
        "out.rays_crop8_of_40": np.stack(crops),
    }
    return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in results.items()}


def texture_results(case: Case) -> dict[str, torch.Tensor]:
    """Raw 16-channel tiles sampled from maps."""
    t = {name: tensor.numpy() for name, tensor in case.tensors.items()}
    maps = np.concatenate([dequantise(t["in.latent_u8"]), t["in.normal_u8"] / 255 * 2 - 1,
                           np.broadcast_to(t["in.emissive"], (*t["in.height_u8"].shape, 3)),
                           (t["in.height_u8"] / 255 * 2 - 1)[..., None]], axis=-1)
    return {"out.tile": torch.from_numpy(sample_tiles(maps, t["in.uv"])),
            "out.bary_weights_row_col": torch.from_numpy(barycentric_grid())}


RESULTS = {"network": network_results, "material": material_results, "environment": environment_results,
           "texture": texture_results}
