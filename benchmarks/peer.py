"""The same frames through gsplat (nerfstudio-project/gsplat), where it is installed."""

from __future__ import annotations

import importlib.util

import torch

from diffphys_ros.types import Camera


def has_gsplat() -> bool:
    """Whether gsplat can be imported."""
    return importlib.util.find_spec("gsplat") is not None


def gsplat_version() -> str:
    """Of the package that is installed."""
    import gsplat

    return gsplat.__version__


def gsplat_cameras(camera: Camera, frames: int, device: str) -> tuple[torch.Tensor, torch.Tensor]:
    """World-to-camera poses (T, 1, 4, 4) and intrinsics (T, 1, 3, 3); gsplat's pixel centres lie at halves, and it knows no skew."""
    pose = torch.linalg.inv(torch.as_tensor(camera.world_from_camera)).float().to(device)
    intrinsics = torch.as_tensor(camera.pixel_from_camera).float().to(device)
    intrinsics[:2, 2] += 0.5
    return pose.expand(frames, 1, 4, 4).contiguous(), intrinsics.expand(frames, 1, 3, 3).contiguous()


def gsplat_frames(
    tensors: list[torch.Tensor], cameras: tuple[torch.Tensor, torch.Tensor], size: tuple[int, int], mode: str = "RGB"
) -> tuple[torch.Tensor, torch.Tensor]:
    """Image (T, h, w, 3 or 4) and alpha (T, h, w) of mean, rotation, scale, opacity, color, each (T, G, ...).

    `size` is width, height [px]; mode "RGB", or "RGB+ED" with the expected depth as the fourth channel. Colours (T, G, K, 3) are
    coefficients of spherical harmonics.
    """
    from gsplat import rasterization

    degree = {1: 0, 4: 1, 9: 2, 16: 3}[tensors[4].shape[2]] if tensors[4].ndim == 4 else None
    image, alpha, _ = rasterization(*tensors, *cameras, *size, packed=False, render_mode=mode, sh_degree=degree)
    return image[:, 0], alpha[:, 0, ..., 0]


def per_frame(leaves: list[torch.Tensor]) -> list[torch.Tensor]:
    """Leaves mean, rotation (T, G, ...), scale, opacity, color (G, ...) for gsplat, which takes all of them frame by frame."""
    frames = len(leaves[0])
    shared = [t.detach().expand(frames, *t.shape).contiguous().requires_grad_() for t in leaves[2:]]
    return [*leaves[:2], *shared]
