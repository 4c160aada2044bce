"""What Gaussians are fitted to: pictures, each with its camera and, where things move, how the Gaussians stand in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import binary_dilation

from ..errors import InputError
from ..inpaint import nearest_known
from ..metrics.image import image_loss
from ..types import Camera, object_mask

ALPHA_WEIGHT = 1.0  # of the squared difference between alpha and mask

Motion = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
"""Means (G, 3) [m] of frame 0 to their displacement (G, 3) [m] in the view and the turn there, quaternions wxyz (G, 4); world frame."""


@dataclass(frozen=True)
class View:
    """One picture. With labels the Gaussians are the object in front of a background; without, they are all that is seen."""

    image: np.ndarray  # RGB, uint8, shape (H, W, 3)
    camera: Camera
    labels: np.ndarray | None = None  # 0 background, 1..n object, 255 ignored; uint8, shape (H, W)
    background: np.ndarray | None = None  # RGB, uint8, shape (H, W, 3); None: the picture around the object, black without labels
    motion: Motion | None = None  # None: the Gaussians stand as in frame 0
    edge_px: int = 0  # pixels around the object that its outline may fill in part: the picture counts there, what they cover does not

    @property
    def mask(self) -> np.ndarray:
        """What the Gaussians must show, bool, shape (H, W)."""
        return np.ones(self.image.shape[:2], bool) if self.labels is None else object_mask(self.labels)

    @property
    def edge(self) -> np.ndarray:
        """Background within edge_px of the object, bool, shape (H, W)."""
        if self.labels is None or not self.edge_px:
            return np.zeros(self.image.shape[:2], bool)
        return binary_dilation(self.mask, iterations=self.edge_px) & (self.labels == 0)

    @property
    def behind(self) -> np.ndarray:
        """RGB behind the Gaussians, uint8, shape (H, W, 3)."""
        if self.background is not None:
            return self.background
        return np.zeros_like(self.image) if self.labels is None else without(self.image, self.labels > 0)


def check_views(views: Sequence[View]) -> list[View]:
    """The views that show the object. Raises InputError where there are none or a picture has another size than its camera."""
    for number, view in enumerate(views):
        wanted = view.camera.height, view.camera.width
        for name, array in (("image", view.image), ("labels", view.labels), ("background", view.background)):
            if array is not None and array.shape[:2] != wanted:
                raise InputError(f"view {number}: {name} of {array.shape[:2]} px must be {wanted} px (rows, columns) as its camera")
    showing = [view for view in views if view.mask.any()]
    if not showing:
        raise InputError(f"views: none of {len(views)} shows the object; give at least one picture whose labels hold it")
    return showing


def without(image: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Image (H, W, 3) with each hidden pixel (H, W) replaced by the nearest other; black where all are hidden."""
    if hidden.all():
        return np.zeros_like(image)
    return nearest_known(image, ~hidden)


def picture_loss(
    image: torch.Tensor, alpha: torch.Tensor, observed: torch.Tensor, mask: torch.Tensor, edge: torch.Tensor, counted: torch.Tensor, *, ssim_weight: float
) -> torch.Tensor:
    """Image loss (paper A.13) + squared difference of alpha and mask, but for the edge. image, observed (..., h, w, 3); alpha, mask, edge, counted (..., h, w)."""
    bleed = torch.where(counted & ~edge, alpha - mask.float(), 0.0).square().sum() / mask.sum()
    return image_loss(image, observed, mask | edge, ssim_weight=ssim_weight) + ALPHA_WEIGHT * bleed
