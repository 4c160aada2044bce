"""A painted block on a painted floor, seen from all around: exact pictures by casting rays."""

import numpy as np

from diffphys_ros.types import Camera

HALF = np.array([0.12, 0.08, 0.1])  # of the block's sides [m]
FLOOR = -HALF[2]  # m
REACH = 0.6  # of the floor [m]
STILL = np.eye(4)


def camera(angle_rad, *, width=80, height=60, distance=0.75, rise=0.35):
    """Looks at the block's middle from a circle above the floor."""
    eye = np.array([distance * np.cos(angle_rad), distance * np.sin(angle_rad), rise])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([right, np.cross(forward, right), forward], 1), eye
    return Camera(np.array([[1.2 * width, 0, (width - 1) / 2], [0, 1.2 * width, (height - 1) / 2], [0, 0, 1]]), pose, width, height)


def picture(cam, world_from_block=STILL):
    """RGB uint8 (H, W, 3), labels (H, W): 1 on the block; the block moved by a rigid transform (4, 4)."""
    pixels = np.stack(np.meshgrid(np.arange(cam.width), np.arange(cam.height)), -1).astype(float)
    rays = cam.rays(pixels)
    turn, shift = world_from_block[:3, :3], world_from_block[:3, 3]
    at, hit = _on_block((cam.position - shift) @ turn, rays @ turn)
    floor = cam.position + rays * np.divide(FLOOR - cam.position[2], rays[..., 2], out=np.full(hit.shape, np.inf), where=rays[..., 2] < 0)[..., None]
    on_floor = np.isfinite(floor).all(-1) & (np.abs(np.nan_to_num(floor[..., :2], posinf=9)).max(-1) < REACH)
    ground = np.where(on_floor[..., None], _paint(np.nan_to_num(floor, posinf=0, neginf=0), 40), 0.0)
    color = np.where(hit[..., None], _paint(at, 75), ground)
    return (color * 255).round().astype(np.uint8), hit.astype(np.uint8)


def cloud(count, seed=0, *, noise_m=0.002):
    """Points (N, 3) [m] of block and floor as a capture finds them, and their colours (N, 3) 0..1."""
    rng = np.random.default_rng(seed)
    side, face = rng.uniform(-1, 1, (count // 2, 3)), rng.integers(0, 3, count // 2)
    side[np.arange(len(side)), face] = rng.choice([-1, 1], len(side))
    block = side * HALF
    floor = np.concatenate([rng.uniform(-REACH, REACH, (count - len(block), 2)), np.full((count - len(block), 1), FLOOR)], 1)
    colors = np.concatenate([_paint(block, 75), _paint(floor, 40)])
    points = np.concatenate([block, floor])
    return points + noise_m * rng.standard_normal(points.shape), colors


def _on_block(eye, rays):
    """Where rays first meet the block (H, W, 3), and whether they do (H, W)."""
    with np.errstate(divide="ignore"):
        near, far = np.sort([(-HALF - eye) / rays, (HALF - eye) / rays], axis=0)
    first, last = near.max(-1), far.min(-1)
    hit = (first < last) & (last > 0)
    return eye + np.where(hit, first, 0.0)[..., None] * rays, hit


def _paint(at, frequency):
    """Colours 0..1 (..., 3) of points (..., 3) [m]: smooth blots with a few hard edges."""
    x, y, z = np.moveaxis(at, -1, 0)
    waves = [np.sin(frequency * x + 2 * np.sin(30 * y)), np.sin(frequency * y + 1.5 * np.cos(25 * z)), np.cos(frequency * z + 20 * x)]
    edge = np.where(np.sin(18 * (x + y + z)) > 0, 0.12, -0.12)
    return np.clip(0.5 + 0.25 * np.stack(waves, -1) + edge[..., None], 0, 1)
