"""Views that the fit takes together: those through one camera, cropped to the window that holds the object in all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..render import Rasterizer, Window, window_around
from ..types import Camera
from .primitives import Tensors
from .view import View, picture_loss

MARGIN_PX = 8  # of the rendered window around the object


@dataclass(frozen=True)
class Group:
    """V views through one camera; B of them are asked at a time, by their numbers."""

    rasterizer: Rasterizer
    window: Window
    image: torch.Tensor  # uint8, (V, h, w, 3)
    mask: torch.Tensor  # bool, (V, h, w)
    edge: torch.Tensor  # View.edge, bool, (V, h, w)
    counted: torch.Tensor  # not ignored, bool, (V, h, w)
    behind: torch.Tensor  # uint8, full pictures, (V, H, W, 3), or (H, W, 3) where all are alike
    views: Sequence[View]

    @classmethod
    def of(cls, views: Sequence[View], device: str) -> Group:
        """Views of one camera."""
        mask = np.stack([view.mask for view in views])
        window = window_around(mask, MARGIN_PX)

        def stacked(arrays: Sequence[np.ndarray]) -> torch.Tensor:
            return torch.as_tensor(np.stack(arrays), device=device)

        counted = [np.ones(mask.shape[1:], bool) if v.labels is None else v.mask | (v.labels == 0) for v in views]
        shared = all(v.background is views[0].background for v in views) and views[0].background is not None
        behind = torch.as_tensor(views[0].behind, device=device) if shared else stacked([v.behind for v in views])
        kinds = [v.image for v in views], mask, [v.edge for v in views], counted
        image, seen, edge, valid = (stacked([cropped(a, window) for a in arrays]) for arrays in kinds)
        return cls(Rasterizer(views[0].camera, device), window, image, seen, edge, valid, behind, views)

    def render(self, gaussians: Tensors, index: list[int]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Image (B, h, w, 3), alpha and depth (B, h, w)."""
        behind = self.behind if self.behind.ndim == 3 else self.behind[index]
        return self.rasterizer.render_frames(*gaussians, behind.float() / 255, window=self.window)

    def observed(self, index: list[int]) -> torch.Tensor:
        """Pictures 0..1, (B, h, w, 3)."""
        return self.image[index].float() / 255

    def loss(self, gaussians: Tensors, index: list[int], *, ssim_weight: float) -> torch.Tensor:
        """How far the Gaussians are from the pictures."""
        image, alpha, _ = self.render(gaussians, index)
        return picture_loss(image, alpha, self.observed(index), self.mask[index], self.edge[index], self.counted[index], ssim_weight=ssim_weight)

    def under(
        self, gaussians: Tensors, number: int, values_of: Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, ...]]
    ) -> tuple[torch.Tensor, ...]:
        """Sums (G,) of at most three values (h, w) over the pixels that each Gaussian fills in one view: the gradient of the image with
        respect to a colour is how much of each pixel the Gaussian fills. values_of(image (h, w, 3), depth (h, w) [m]) as rendered."""
        mean, rotation, scale, opacity, color = (t.detach() for t in gaussians)
        color.requires_grad_()
        image, _, depth = (t[0] for t in self.render((mean, rotation, scale, opacity, color), [number]))
        values = values_of(image.detach(), depth.detach())
        asked = torch.stack([(image[..., k] * value).sum() for k, value in enumerate(values)]).sum()
        return torch.autograd.grad(asked, color)[0].unbind(1)[: len(values)]


def cropped(array: np.ndarray, window: Window) -> np.ndarray:
    """The window of a picture (H, W, ...)."""
    left, top, right, bottom = window
    return array[top:bottom, left:right]


def groups_of(views: Sequence[View], device: str) -> list[Group]:
    """Views by camera, in the order of their first view."""
    found: list[list[View]] = []
    for view in views:
        same = next((g for g in found if _same(g[0].camera, view.camera)), None)
        if same is None:
            found.append([view])
        else:
            same.append(view)
    return [Group.of(members, device) for members in found]


def _same(a: Camera, b: Camera) -> bool:
    arrays = ((a.pixel_from_camera, b.pixel_from_camera), (a.world_from_camera, b.world_from_camera))
    return (a.width, a.height) == (b.width, b.height) and all(np.array_equal(x, y) for x, y in arrays)
