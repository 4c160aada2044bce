"""Tiny networks with random weights, in the files that transformers writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

transformers = pytest.importorskip("transformers", reason="the package transformers is not installed; pip install '.[models]'")
SIDE = 64  # px, of the square that the SAM networks see


def sam(folder: Path, *, everything: bool = False) -> str:
    """A SAM checkpoint; one that marks `everything` offers masks without a hole."""
    torch.manual_seed(3)
    vision = {"hidden_size": 16, "output_channels": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": SIDE, "patch_size": 8}
    vision |= {"mlp_dim": 32, "global_attn_indexes": [1], "window_size": 4, "num_pos_feats": 8}
    prompt = {"hidden_size": 16, "image_size": SIDE, "patch_size": 8, "mask_input_channels": 4}
    return _saved(transformers.SamModel(transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=_decoder())), folder, everything)


def sam2(folder: Path, *, everything: bool = False) -> str:
    """A SAM 2 checkpoint, as `sam`."""
    torch.manual_seed(3)
    width = [8, 16, 32, 64]
    backbone = transformers.Sam2HieraDetConfig(
        hidden_size=8, image_size=[SIDE, SIDE], blocks_per_stage=[1, 1, 2, 1], embed_dim_per_stage=width, num_attention_heads_per_stage=[1, 1, 2, 2],
        global_attention_blocks=[3], window_size_per_stage=[8, 4, 8, 4], window_positional_embedding_background_size=[4, 4],
    )  # fmt: skip
    sizes = [[SIDE // 4, SIDE // 4], [SIDE // 8, SIDE // 8], [SIDE // 16, SIDE // 16]]
    vision = transformers.Sam2VisionConfig(backbone_config=backbone, backbone_channel_list=width[::-1], backbone_feature_sizes=sizes, fpn_hidden_size=16)
    prompt = {"hidden_size": 16, "image_size": SIDE, "patch_size": 16}
    return _saved(transformers.Sam2Model(transformers.Sam2Config(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=_decoder())), folder, everything)


def dpt(folder: Path) -> str:
    """A MiDaS (DPT) checkpoint: relative inverse depth."""
    torch.manual_seed(5)
    config = transformers.DPTConfig(
        hidden_size=16, num_hidden_layers=4, num_attention_heads=2, intermediate_size=32, image_size=64, patch_size=16, backbone_out_indices=[0, 1, 2, 3],
        neck_hidden_sizes=[8, 8, 8, 8], fusion_hidden_size=8, reassemble_factors=[4, 2, 1, 0.5], is_hybrid=False, add_projection=False,
    )  # fmt: skip
    return _depth_network(transformers.DPTForDepthEstimation(config), folder, multiple=16)


def depth_anything(folder: Path, *, metric: bool) -> str:
    """A Depth Anything checkpoint: relative inverse depth, or metres up to 20 m."""
    torch.manual_seed(7)
    stages = [f"stage{k}" for k in (1, 2, 3, 4)]
    backbone = transformers.Dinov2Config(
        hidden_size=16, num_hidden_layers=4, num_attention_heads=2, image_size=56, patch_size=14, out_features=stages, reshape_hidden_states=False, apply_layernorm=True
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone, reassemble_hidden_size=16, patch_size=14, neck_hidden_sizes=[8, 8, 8, 8], fusion_hidden_size=8, head_hidden_size=8,
        depth_estimation_type="metric" if metric else "relative", max_depth=20 if metric else 1,
    )  # fmt: skip
    return _depth_network(transformers.DepthAnythingForDepthEstimation(config), folder, multiple=14, last=0.02 if metric else 1.0)


def _depth_network(model: torch.nn.Module, folder: Path, *, multiple: int, last: float = 1.0) -> str:
    """Weights large enough that the output depends on the image; beside them the image processor's file as the hub's checkpoints have it."""
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter, 0.05, 0.3)
    if last < 1:  # before a sigmoid: far from its ends
        model.head.conv3.weight.data *= last
    size = 4 * multiple
    processor = transformers.DPTImageProcessorPil(size={"height": size, "width": size}, ensure_multiple_of=multiple)
    processor.save_pretrained(folder)
    file = folder / "preprocessor_config.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"image_processor_type": "DPTImageProcessor"}))
    return _saved(model, folder, False)


def _decoder() -> dict[str, int]:
    return {"hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "mlp_dim": 32, "iou_head_hidden_dim": 16}


def _saved(model: torch.nn.Module, folder: Path, everything: bool) -> str:
    if everything:  # every mask is a product of two vectors: make both of them ones
        decoder = model.mask_decoder
        for layer in (decoder.upscale_conv2, *(head.proj_out for head in decoder.output_hypernetworks_mlps)):
            torch.nn.init.zeros_(layer.weight)
            torch.nn.init.ones_(layer.bias)
    model.eval().save_pretrained(folder)
    return str(folder)
