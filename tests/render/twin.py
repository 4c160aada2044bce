"""A readable renderer of 3D Gaussians in plain torch: every pixel against every Gaussian, differentiated by autograd."""

import math

import torch
from numpy.polynomial import legendre, polynomial


def rotation_matrix(q):
    """(G, 3, 3) from quaternions wxyz (G, 4) of any norm."""
    w, x, y, z = (q / q.norm(dim=-1, keepdim=True)).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def project(mean, rotation, scale, camera):
    """Centres (G, 2) [px], covariances (G, 2, 2) [px^2] and depths (G,) [m]."""
    k = torch.as_tensor(camera.pixel_from_camera, dtype=mean.dtype)
    pose = torch.as_tensor(camera.world_from_camera, dtype=mean.dtype)
    local = (mean - pose[:3, 3]) @ pose[:3, :3]
    x, y, z = local.unbind(-1)
    centre = (local @ k.T)[:, :2] / z[:, None]
    size = torch.tensor([camera.width, camera.height], dtype=mean.dtype)
    focal = torch.stack([k[0, 0], k[1, 1]])
    at = torch.stack([x / z, y / z], -1)
    at = torch.minimum(torch.maximum(at, (-0.15 * size - k[:2, 2]) / focal), (1.15 * size - k[:2, 2]) / focal)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([k[0, 0] / z, k[0, 1] / z, -(k[0, 0] * at[:, 0] + k[0, 1] * at[:, 1]) / z], -1),
            torch.stack([zero, k[1, 1] / z, -k[1, 1] * at[:, 1] / z], -1),
        ],
        -2,
    )
    half = jacobian @ pose[:3, :3].T @ rotation_matrix(rotation) * scale[:, None]
    return centre, half @ half.transpose(-1, -2) + 0.3 * torch.eye(2, dtype=mean.dtype), z


def render(mean, rotation, scale, opacity, color, camera, background=None):
    """Image (H, W, 3), alpha (H, W) and expected depth (H, W), one Gaussian after another from near to far."""
    centre, covariance, z = project(mean, rotation, scale, camera)
    rows, columns = torch.meshgrid(*(torch.arange(n, dtype=mean.dtype) for n in (camera.height, camera.width)), indexing="ij")
    passed, going = torch.ones_like(rows), torch.ones_like(rows, dtype=torch.bool)
    image, depth = torch.zeros(*rows.shape, 3, dtype=mean.dtype), torch.zeros_like(rows)
    for i in torch.argsort(z.detach(), stable=True).tolist():
        if z[i] <= 0.01:
            continue
        offset = torch.stack([columns, rows], -1) - centre[i]
        distance2 = torch.einsum("hwi,ij,hwj->hw", offset, torch.linalg.inv(covariance[i]), offset)
        alpha = (opacity[i] * torch.exp(-0.5 * distance2)).clamp_max(0.999)
        alpha = torch.where(opacity[i] * torch.exp(-0.5 * distance2) >= 1 / 255, alpha, 0.0)
        going = going & (passed * (1 - alpha) > 1e-4)
        weight = torch.where(going, passed * alpha, 0.0)
        image, depth = image + weight[..., None] * color[i], depth + weight * z[i]
        passed = torch.where(going, passed * (1 - alpha), passed)
    alpha = 1 - passed
    depth = torch.where(alpha > 0, depth / alpha.clamp_min(1e-12), 0.0)
    if background is not None:
        image = image + passed[..., None] * background
    return image, alpha, depth


def harmonics(direction, degree):
    """Real spherical harmonics with Condon-Shortley phase (..., (degree + 1)^2) at unit directions (..., 3), from their definition:
    derivatives of Legendre polynomials of z times the powers of x + iy."""
    x, y, z = direction.unbind(-1)
    values = []
    for band in range(degree + 1):
        for m in range(-band, band + 1):
            a = abs(m)
            norm = math.sqrt((2 * band + 1) / (4 * math.pi) * math.factorial(band - a) / math.factorial(band + a) * (2 if a else 1))
            along = polynomial.polyder(legendre.leg2poly([0] * band + [1]), a)
            around = torch.complex(x, y) ** a if a else torch.ones_like(torch.complex(x, y))
            height = sum(float(c) * z**k for k, c in enumerate(along))
            values.append((-1) ** a * norm * height * (around.imag if m < 0 else around.real))
    return torch.stack(values, -1)


def shade(mean, coefficients, camera):
    """Colours (G, 3) of coefficients (G, K, 3) seen by the camera."""
    away = mean - torch.as_tensor(camera.position, dtype=mean.dtype)
    basis = harmonics(away / away.norm(dim=-1, keepdim=True), math.isqrt(coefficients.shape[1]) - 1)
    return (0.5 + torch.einsum("gk,gkc->gc", basis, coefficients)).clamp_min(0)
