"""How far rendered frames and moved points are from observed ones: differentiable losses, and the metrics of a report.

Image arguments are torch tensors (..., H, W, 3) with values 0..1 for the losses; the metrics also take numpy arrays,
where uint8 means 0..255. A mask (..., H, W) is true on the object; types.object_mask makes it from a label image and leaves
ignored pixels out.
"""

from __future__ import annotations

import numpy as np
import torch

from ..errors import InputError
from ..types import object_mask

SSIM_SIGMA_PX = 1.5  # window of Wang et al. 2004, "Image quality assessment: from error visibility to structural similarity"
SSIM_RADIUS_PX = 5
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2  # of the same, for values 0..1
PSNR_FLOOR = 1e-10  # smallest mean squared error that counts: 100 dB
DEPTH_SCALE_M = 0.02  # depth errors beyond this count linearly: silhouettes mix near and far

Image = np.ndarray | torch.Tensor


def image_loss(rendered: torch.Tensor, observed: torch.Tensor, mask: torch.Tensor, *, ssim_weight: float) -> torch.Tensor:
    """Masked L2 + ssim_weight * (1 - SSIM) (paper A.13), each a mean over the object's pixels in all frames, so that
    neither image size nor number of frames changes their balance. 0 where the mask is empty."""
    loss = masked_l2(rendered, observed, mask)
    return loss + ssim_weight * (1 - masked_ssim(rendered, observed, mask)) if ssim_weight and bool(mask.any()) else loss


def coarser(image: torch.Tensor, px: int) -> torch.Tensor:
    """Means of an image (S, H, W, 3) over blocks of px x px pixels, those at the border over what there is of them."""
    return torch.nn.functional.avg_pool2d(image.movedim(-1, 1), px, ceil_mode=True, count_include_pad=False).movedim(1, -1)


def coarser_mask(mask: torch.Tensor, px: int) -> torch.Tensor:
    """Which of the same blocks hold a pixel of a mask (S, H, W)."""
    return torch.nn.functional.max_pool2d(mask.float()[:, None], px, ceil_mode=True)[:, 0] > 0


def masked_l2(rendered: torch.Tensor, observed: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean squared difference over the object's pixels and channels."""
    squared = torch.where(mask[..., None], rendered - observed, 0.0).square()
    return squared.sum() / (mask.sum() * rendered.shape[-1]).clamp_min(1)


def masked_ssim(rendered: torch.Tensor, observed: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean over the object's pixels of the structural similarity of the two masked images (paper A.13), -1..1."""
    a, b = (torch.where(mask[..., None], image, 0.0).movedim(-1, -3) for image in (rendered, observed))
    weight = mask[..., None, :, :].expand(a.shape)
    return torch.where(weight, ssim_map(a, b), 0.0).sum() / weight.sum().clamp_min(1)


def ssim_map(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Structural similarity (..., H, W) of two images (..., H, W) of values 0..1 under an 11 x 11 Gaussian window
    (Wang et al. 2004, equation 13). Beyond the border both images count as 0."""
    rows, columns = (_blur_matrix(n, like=a) for n in a.shape[-2:])
    mean_b = rows @ b @ columns  # by itself: an observed image needs no way back
    mean_a, squares, ab = (rows @ torch.stack([a, a * a + b * b, a * b]) @ columns).unbind(0)
    both = mean_a**2 + mean_b**2
    luminance = (2 * mean_a * mean_b + SSIM_C1) / (both + SSIM_C1)
    return luminance * (2 * (ab - mean_a * mean_b) + SSIM_C2) / (squares - both + SSIM_C2)


def depth_loss(rendered: torch.Tensor, observed: torch.Tensor, mask: torch.Tensor, *, scale_m: float = DEPTH_SCALE_M) -> torch.Tensor:
    """Mean Charbonnier loss [m^2] of depths (..., H, W) [m] over the object's pixels whose depth was observed (finite, > 0).

    Squared error for errors below scale_m, 2 * scale_m * |error| far above.
    """
    known = known_depth(observed, mask)
    error = torch.where(known, rendered - torch.nan_to_num(observed), 0.0)
    return 2 * scale_m**2 * (torch.sqrt(1 + (error / scale_m) ** 2) - 1).sum() / known.sum().clamp_min(1)


def known_depth(observed: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Where in a mask (..., H, W) a depth was observed."""
    return mask & torch.isfinite(observed) & (observed > 0)


def psnr_masked(rendered: Image, observed: Image, mask: Image) -> float:
    """Peak signal-to-noise ratio [dB] over the object's pixels, at most 100. Raises InputError for an empty mask."""
    error = masked_l2(_unit(rendered), _unit(observed), _mask(mask))
    return float(-10 * torch.log10(error.clamp_min(PSNR_FLOOR)))


def ssim_masked(rendered: Image, observed: Image, mask: Image) -> float:
    """masked_ssim as a number. Raises InputError for an empty mask."""
    mask = _mask(mask)
    rows, columns = (slice(int(line.min()), int(line.max()) + 1) for line in mask.reshape(-1, *mask.shape[-2:]).any(0).nonzero().unbind(1))
    shown, seen = (_unit(image)[..., rows, columns, :] for image in (rendered, observed))  # all else is black in both
    return float(masked_ssim(shown, seen, mask[..., rows, columns]))


def psnr_frozen_frame(frames: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """psnr_masked [dB] of frame 0 against every later frame (T-1,): what a rendering must beat. NaN where no object is seen.

    frames uint8 (T, H, W, 3), labels uint8 (T, H, W).
    """
    masks = map(object_mask, labels[1:])
    return np.array([psnr_masked(frames[0], frame, mask) if mask.any() else np.nan for frame, mask in zip(frames[1:], masks, strict=True)])


def _blur_matrix(size: int, *, like: torch.Tensor) -> torch.Tensor:
    """Symmetric (size, size) matrix that blurs a line of pixels; as a product it is faster on a CPU than a convolution."""
    offset = torch.arange(size, device=like.device)
    distance = (offset[:, None] - offset).to(like.dtype)
    span = torch.arange(-SSIM_RADIUS_PX, SSIM_RADIUS_PX + 1, device=like.device, dtype=like.dtype)
    total = torch.exp(-0.5 * (span / SSIM_SIGMA_PX) ** 2).sum()
    return torch.where(distance.abs() <= SSIM_RADIUS_PX, torch.exp(-0.5 * (distance / SSIM_SIGMA_PX) ** 2) / total, 0.0)


def _unit(image: Image) -> torch.Tensor:
    tensor = torch.as_tensor(image).detach().cpu()
    return tensor.double() / 255 if tensor.dtype == torch.uint8 else tensor.double()


def _mask(mask: Image) -> torch.Tensor:
    tensor = torch.as_tensor(mask).detach().cpu().bool()
    if not tensor.any():
        raise InputError("mask: has no pixel to compare; give a mask that covers the object")
    return tensor
