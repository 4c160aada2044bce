"""Surface depth by a monocular network: MiDaS/DPT (Ranftl et al. 2021), Depth Anything, ZoeDepth and their like, through transformers.

A MiDaS-class network gives inverse depth up to an unknown factor and offset. Depth images of the clip fix both. Otherwise the distance is that of
the clamp, of the known size or assumed, and the relief of the visible surface is taken as half the thickness, the silhouette's own where none is known:
the network then says where the surface bulges, not how far the object leans.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..pretrained import image_processor, model_of
from ..types import Camera, Clip
from .inflate import inflated_depth
from .scale import CLAMP, DEPTH_TOPIC, DepthSource, object_distance, on_clamp
from .topic import fill_holes

SETTING = "depth.model"
METRIC = (
    "zoedepth",
    "glpn",
    "depth_pro",
    "prompt_depth_anything",
)  # model types whose output is in metres; others say so in their configuration
TAILS = (0.05, 0.95)  # quantiles between which the relief is measured
ROUNDS = 5  # of the robust fit to measured depth


def network_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels by the network `depth.model`, and what it comes from with what fixed its scale.

    Raises InputError for a checkpoint that cannot be used or finds no depth.
    """
    name = settings.depth.model
    if not name:
        raise InputError(
            "depth.source is 'network' but depth.model is not set; give the folder or hub id of a depth-estimation checkpoint, or choose 'inflate'"
        )
    predicted, metric = predict(name, clip.frames[0], settings.fit.device)
    if metric:
        depth, scale = metric_depth(predicted, clip, mask, settings)
    else:
        depth, scale = scaled_inverse(predicted, clip, mask, settings)
    if not (depth[mask] > 0).any():
        raise InputError(
            f"depth.model {name!r}: sees nothing before the camera on the object; choose another checkpoint or depth.source 'inflate'"
        )
    return fill_holes(depth, mask).astype(np.float32), DepthSource(f"network {Path(name).name}", scale)


def predict(name: str, frame: np.ndarray, device: str) -> tuple[np.ndarray, bool]:
    """What a network says about an RGB frame (H, W, 3): depth [m] (H, W) and True, or inverse depth of unknown factor and offset and False."""
    import torch

    model, config = model_of(name, {"*": "AutoModelForDepthEstimation"}, setting=SETTING, device=device)
    processor = image_processor(name, setting=SETTING)
    inputs = processor(images=frame, return_tensors="pt").to(next(model.parameters()).device)
    with torch.no_grad():
        output = model(**inputs)
    value = _full_size(processor, output, frame.shape[:2])
    return value, config.model_type in METRIC or getattr(config, "depth_estimation_type", "") == "metric"


def metric_depth(predicted: np.ndarray, clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, str]:
    """A network's metres (H, W), corrected by a factor where the scene says how far or how large the object is."""
    reference = _reference(clip, mask, settings)
    middle = float(np.median(predicted[mask])) if mask.any() else 1.0
    if reference is None or middle <= 0:
        return predicted, "the network's own metres, unchecked"
    return predicted * (reference[0] / middle), reference[1]


def scaled_inverse(inverse: np.ndarray, clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, str]:
    """Depth [m] (H, W) of a relative inverse depth (H, W) that grows towards the camera, and what fixed factor and offset."""
    if clip.depth is not None and (mask & (clip.depth[0] > 0)).any():
        known = mask & (clip.depth[0] > 0)
        factor, offset = _line(inverse[known], 1 / clip.depth[0][known])
        return 1 / np.maximum(factor * inverse + offset, 1e-6), DEPTH_TOPIC
    found = _reference(clip, mask, settings)
    distance, scale = found if found is not None else object_distance(clip, mask, settings)
    relief = _relief(clip.camera, mask, distance, settings)
    low, middle, high = np.quantile(inverse[mask], (TAILS[0], 0.5, TAILS[1]))
    share = np.clip((inverse - middle) / max(high - low, 1e-12), -1, 1)
    return np.maximum(distance - relief * share, 0.1 * distance), f"{scale}; its relief is taken as {1e3 * relief:.3g} mm"


def _reference(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[float, str] | None:
    """The object's distance [m] and what fixed it; None where nothing does."""
    if on_clamp(clip, settings):
        depth, _ = inflated_depth(clip, mask, settings)
        return float(np.median(depth[mask])), CLAMP
    return object_distance(clip, mask, settings) if settings.scene.size_m is not None else None


def _relief(camera: Camera, mask: np.ndarray, distance: float, settings: Settings) -> float:
    """How far the visible surface is taken to extend along the line of sight [m]: half the thickness, or half the silhouette's width."""
    if settings.scene.thickness_m is not None:
        return settings.scene.thickness_m / 2
    widest = float(cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5).max())
    return widest * distance / camera.focal_px


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Factor and offset of a line through most of the points (M,), by reweighted least squares; a constant where x has no spread."""
    weight, fitted = np.ones_like(x), (0.0, float(np.median(y)))
    for _ in range(ROUNDS if np.ptp(x) > 1e-9 * max(np.abs(x).max(), 1e-12) else 0):
        root = np.sqrt(weight)
        factor, offset = np.linalg.lstsq(np.stack([x, np.ones_like(x)], -1) * root[:, None], y * root, rcond=None)[0]
        fitted = float(factor), float(offset)
        error = np.abs(factor * x + offset - y)
        weight = 1 / np.maximum(error, max(float(np.median(error)), 1e-12))
    return fitted


def _full_size(processor: Any, output: Any, size: tuple[int, int]) -> np.ndarray:
    """The prediction in the frame's size, float (H, W)."""
    import torch

    if hasattr(processor, "post_process_depth_estimation"):
        value = processor.post_process_depth_estimation(output, target_sizes=[size])[0]["predicted_depth"]
    else:
        value = torch.nn.functional.interpolate(output.predicted_depth[:, None], size=size, mode="bicubic", align_corners=False)[0, 0]
    return value.squeeze().double().cpu().numpy()
