"""Object mask by Segment Anything (Kirillov et al. 2023) or SAM 2 (Ravi et al. 2024), prompted by box, point or what moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..pretrained import model_of
from ..types import Clip
from .motion import motion_mask
from .prompt import NO_MARK, Mark, Prompt
from .regions import filled

SETTING = "segment.model"
ARCHITECTURES = {"sam": "SamModel", "sam_hq": "SamHQModel", "sam2": "Sam2Model", "sam2_video": "Sam2Model"}
KEEPS_ASPECT = ("sam", "sam_hq")  # pads the shorter side of an image; SAM 2 stretches it
MEAN, DEVIATION = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)  # of ImageNet's pixels, 0..255, as every published SAM was trained
LEAST_SHARE, MOST_SHARE = 0.001, 0.95  # of the image that an object may cover


def sam_mask(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W), by the network `segment.model`.

    Its prompt is `segment.box_px` and the marked point, else `segment.point_px`. Without both it is the box of what moves, and of the masks that the network offers the
    one most like the moving one counts. Raises InputError for a checkpoint that cannot be used and a mask that is no object.
    """
    name = settings.segment.model
    if not name:
        raise InputError(
            "segment.method is 'sam' but segment.model is not set; give the folder or hub id of a SAM checkpoint, or choose 'motion'"
        )
    model, config = model_of(name, ARCHITECTURES, setting=SETTING, device=settings.fit.device)
    frame, prompt = clip.frames[0], Prompt.of(settings, mark, clip.frames.shape[1:3])
    moving = motion_mask(clip, settings) > 0 if prompt.box is None and prompt.point is None else None
    shown = prompt if moving is None else _prompt_of(moving)
    masks, quality = offered(model, config, frame, shown)
    best = int(np.argmax(quality if moving is None else [_overlap(mask, moving) for mask in masks]))
    mask = filled(shown.region(masks[best]))
    if not LEAST_SHARE < mask.mean() < MOST_SHARE:
        raise InputError(
            f"segment.model {name!r}: marks {100 * mask.mean():.2f} % of frame 0 as object, needs between {100 * LEAST_SHARE:g} and {100 * MOST_SHARE:g} %; "
            "give segment.box_px, another checkpoint or scene.first_mask"
        )
    return mask.astype(np.uint8)


def offered(model: Any, config: Any, frame: np.ndarray, prompt: Prompt) -> tuple[np.ndarray, np.ndarray]:
    """The masks (M, H, W) bool that a network offers for one prompt in an RGB frame (H, W, 3), and its estimate of their IoU (M,)."""
    points = None if prompt.point is None else prompt.point[None]
    masks, quality = offered_at(model, config, frame, points, box=prompt.box)
    return masks[0], quality[0]


def offered_at(model: Any, config: Any, frame: np.ndarray, points: np.ndarray | None, *, box: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The masks (P, M, H, W) bool that a network offers in an RGB frame (H, W, 3), which it looks at once, for each of P points (u, v) [px] by itself, or for
    a box (left, top, right, bottom) [px] and at most one point, and its estimates of their IoU (P, M)."""
    import torch

    fit = _Fit.of(frame.shape, int(config.prompt_encoder_config.image_size), keep_aspect=config.model_type in KEEPS_ASPECT)
    device = next(model.parameters()).device
    inputs = {"pixel_values": torch.as_tensor(fit.pixels(frame))[None]}
    if box is not None:
        inputs["input_boxes"] = torch.as_tensor((box.reshape(2, 2) * fit.scale).reshape(1, 1, 4), dtype=torch.float32)
    if points is not None:
        inputs["input_points"] = torch.as_tensor((points * fit.scale)[None, :, None], dtype=torch.float32)
        inputs["input_labels"] = torch.ones((1, len(points), 1), dtype=torch.long)
    with torch.no_grad():
        output = model(**{key: value.to(device) for key, value in inputs.items()}, multimask_output=True)
    logits = output.pred_masks[0].float().cpu().numpy()
    return np.stack([[fit.mask(logit) for logit in each] for each in logits]), output.iou_scores[0].float().cpu().numpy()


@dataclass(frozen=True)
class _Fit:
    """How an image of height x width lies in the square that a network sees."""

    height: int
    width: int
    side: int  # of the square [px]
    size: tuple[int, int]  # width and height of the image inside the square [px]

    @classmethod
    def of(cls, shape: tuple[int, ...], side: int, *, keep_aspect: bool) -> _Fit:
        height, width = shape[:2]
        scale = side / max(height, width)
        return cls(height, width, side, (int(width * scale + 0.5), int(height * scale + 0.5)) if keep_aspect else (side, side))

    @property
    def scale(self) -> np.ndarray:
        """Pixels of the square per pixel of the image, along u and v (2,)."""
        return np.array(self.size) / (self.width, self.height)

    def pixels(self, frame: np.ndarray) -> np.ndarray:
        """Normalised channels, float32 (3, side, side), 0 beside the image."""
        small = cv2.resize(frame, self.size, interpolation=cv2.INTER_AREA if self.scale.max() < 1 else cv2.INTER_LINEAR)
        square = np.zeros((self.side, self.side, 3), np.float32)
        square[: self.size[1], : self.size[0]] = (small - np.array(MEAN)) / np.array(DEVIATION)
        return np.ascontiguousarray(square.transpose(2, 0, 1))

    def mask(self, logit: np.ndarray) -> np.ndarray:
        """The image's pixels (H, W) where a mask's logits (h, w), which cover the square, are positive."""
        square = cv2.resize(logit, (self.side, self.side), interpolation=cv2.INTER_LINEAR)
        return cv2.resize(square[: self.size[1], : self.size[0]], (self.width, self.height), interpolation=cv2.INTER_LINEAR) > 0


def _prompt_of(mask: np.ndarray) -> Prompt:
    """The box of a mask and its innermost point."""
    v, u = np.nonzero(mask)
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    inner = np.unravel_index(int(depth.argmax()), mask.shape)
    return Prompt(np.array([u.min(), v.min(), u.max(), v.max()], float), np.array(inner[::-1], float))


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))
