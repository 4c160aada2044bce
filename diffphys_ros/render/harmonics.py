# mypy: disable-error-code="operator,valid-type"

"""Colours that change with the direction of view: real spherical harmonics of degree 0 to 3."""

from functools import lru_cache

import torch
import warp as wp

from .step import BLOCK, RecordedLaunch, addresses, stream_of

KNOWN_SIZES = 256  # numbers of frames and Gaussians, and cameras, for which launches are kept
DEGREES = {1: 0, 4: 1, 9: 2, 16: 3}  # of so many coefficients


@wp.func
def from_direction(degree: int, first: int, d: wp.vec3, c: wp.array(dtype=wp.vec3)):
    """Sum over the basis in the order and with the signs of Kerbl et al. 2023 (l = 0..degree, m = -l..l), at unit direction d."""
    x, y, z = d[0], d[1], d[2]
    xx, yy, zz = x * x, y * y, z * z
    rgb = 0.28209479177387814 * c[first]
    if degree > 0:
        rgb = rgb + 0.4886025119029199 * (z * c[first + 2] - y * c[first + 1] - x * c[first + 3])
    if degree > 1:
        rgb = rgb + 1.0925484305920792 * (x * y * c[first + 4] - y * z * c[first + 5] - x * z * c[first + 7])
        rgb = rgb + 0.31539156525252005 * (2.0 * zz - xx - yy) * c[first + 6] + 0.5462742152960396 * (xx - yy) * c[first + 8]
    if degree > 2:
        rgb = rgb - 0.5900435899266435 * (y * (3.0 * xx - yy) * c[first + 9] + x * (xx - 3.0 * yy) * c[first + 15])
        rgb = rgb - 0.4570457994644658 * (4.0 * zz - xx - yy) * (y * c[first + 11] + x * c[first + 13])
        rgb = rgb + 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * c[first + 12]
        rgb = rgb + 1.445305721320277 * z * (2.0 * x * y * c[first + 10] + (xx - yy) * c[first + 14])
    return rgb


@wp.kernel
def shade_frames(
    # in:
    frames: int,
    gaussians: int,
    degree: int,
    eye: wp.vec3,
    mean: wp.array(dtype=wp.vec3),
    coefficient: wp.array(dtype=wp.vec3),
    # out:
    color: wp.array(dtype=wp.vec3),
):
    # One thread goes through a Gaussian's frames, so that derivatives of its coefficients are added up in order.
    g = wp.tid()
    for frame in range(frames):
        i = frame * gaussians + g
        rgb = from_direction(degree, g * (degree + 1) * (degree + 1), wp.normalize(mean[i] - eye), coefficient)  # type: ignore[arg-type]
        color[i] = wp.max(rgb + wp.vec3(0.5, 0.5, 0.5), wp.vec3(0.0, 0.0, 0.0))


def shade(mean: torch.Tensor, coefficients: torch.Tensor, eye: tuple[float, float, float]) -> torch.Tensor:
    """Colours (T * G, 3) of Gaussians at mean (T, G, 3) [m] seen from eye [m], of coefficients (G, K, 3), K = 1, 4, 9 or 16.

    As in Kerbl et al. 2023: 0.5 + the sum over the basis, not below 0. Contiguous float32 tensors; differentiable in both.
    """
    return _Shade.apply(mean, coefficients, eye)


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx, mean, coefficients, eye):
        ctx.save_for_backward(mean, coefficients)
        ctx.eye = eye
        color = torch.empty_like(mean).view(-1, 3)
        _step(mean, coefficients, eye)(stream_of(mean.device), *addresses(mean, coefficients, color))
        return color

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, d_color):
        mean, coefficients = ctx.saved_tensors
        d_mean, d_coefficients = torch.zeros_like(mean), torch.zeros_like(coefficients)
        color = torch.empty_like(mean)
        seen = d_color.clone(memory_format=torch.contiguous_format)  # which the kernel may change
        arrays = addresses(mean, coefficients, color, d_mean, d_coefficients, seen)
        _step(mean, coefficients, ctx.eye, adjoint=True)(stream_of(mean.device), *arrays)
        return d_mean, d_coefficients, None


def _step(mean, coefficients, eye, adjoint=False):
    return _recorded(*mean.shape[:2], DEGREES[coefficients.shape[1]], eye, mean.device, adjoint)


@lru_cache(KNOWN_SIZES)
def _recorded(frames, gaussians, degree, eye, device, adjoint):
    numbers, arrays = [frames, gaussians, degree, wp.vec3(*eye)], [wp.vec3] * (6 if adjoint else 3)
    return RecordedLaunch(shade_frames, gaussians, numbers, arrays, wp.device_from_torch(device), adjoint=adjoint, block_dim=BLOCK)
