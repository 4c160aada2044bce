"""Hostile clips through assembly, camera, masks, segmentation and tracks."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.camera import camera_from_fov, camera_from_info, undistorter
from diffphys_ros.errors import InputError
from diffphys_ros.segment import label_clip
from diffphys_ros.tracks import follow
from diffphys_ros.types import Camera, Clip, Tracks, object_mask

COUNT = 10_000
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 33_333_333
SIZES = ((36, 48), (48, 64), (48, 64), (64, 80), (32, 32))
ODD_SIZES = ((1, 1), (2, 3), (7, 7), (24, 32), (9, 31), (1, 64), (64, 1), (31, 300), (32, 300), (33, 37), (24, 300))
VALUES = (0.0, -1.0, 1e-30, 1e30, 3e38, np.nan, np.inf, -np.inf)


def case(seed: int, folder: Path) -> str:
    """One hostile clip, labelled and followed."""
    rng = np.random.default_rng(seed)
    try:
        clip, settings = _clip(rng), _settings(rng, folder)
        clip = clip.with_labels(_checked_labels(label_clip(clip, settings), clip))
        mask = object_mask(clip.labels[0])
        _check_tracks(follow(clip, _surface(rng, clip, mask), settings), clip)
    except InputError as error:
        text = str(error)
        assert text
        assert text.isprintable(), f"unprintable: {text!r}"
        assert len(text) < 600, f"{len(text)} characters: {text[:200]!r}"
        return "refused"
    return "taken"


def _checked_labels(labels: np.ndarray, clip: Clip) -> np.ndarray:
    assert labels.shape == clip.frames.shape[:3]
    assert labels.dtype == np.uint8
    return labels


def _check_tracks(tracks: Tracks, clip: Clip) -> None:
    count = tracks.pixels.shape[1]
    assert count
    assert tracks.pixels.shape == (len(clip), count, 2)
    assert tracks.valid[0].all()
    assert np.isfinite(tracks.points[tracks.valid]).all()
    assert np.isfinite(tracks.noise_m)
    assert tracks.sd_m is not None
    assert not np.isnan(tracks.sd_m).any()


def _surface(rng: np.random.Generator, clip: Clip, mask: np.ndarray) -> np.ndarray:
    """Depth of the object in frame 0 as the depth stage gives it: finite, 0 where unknown."""
    depth = np.full(mask.shape, 0.5, np.float32) if clip.depth is None else clip.depth[0]
    hole = rng.random(mask.shape) < rng.choice([0.0, 0.0, 0.0, 0.3, 1.0])
    return np.where(mask & ~hole, depth, 0).astype(np.float32)


# -- the clip


def _clip(rng: np.random.Generator) -> Clip:
    sizes = ODD_SIZES if rng.random() < 0.1 else SIZES
    height, width = sizes[int(rng.integers(len(sizes)))]
    count = int(rng.choice([0, 1, 2, 3, 5, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 12]))
    frames = _frames(rng, count, height, width)
    stamps = _stamps(rng, count)
    camera = _camera(rng, width, height)
    images = list(zip(stamps, frames, strict=True))
    if images and rng.random() < 0.05:
        images[-1] = (images[-1][0], np.zeros((height + 1, width, 3), np.uint8))
    clip = assemble(images, _depths(rng, images, height, width), camera, str(rng.choice(["clip", "", "é"])))
    return replace(clip, first_labels=_mask(rng, height, width)) if rng.random() < 0.5 else clip


def _frames(rng: np.random.Generator, count: int, height: int, width: int) -> list[np.ndarray]:
    kind = int(rng.choice([0, 1, 2, 3, 4, 4, 5, 6, 7, 8, 8, 8]))
    noise = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    texture = rng.integers(0, 256, (height // 2 + 1, width // 2 + 1, 3)).astype(np.uint8)
    smooth = cv2.GaussianBlur(texture, (0, 0), 1.0).reshape(texture.shape)
    frames = []
    for k in range(count):
        frame = np.full((height, width, 3), int(rng.integers(0, 256)) if kind == 7 else 90, np.uint8)
        if kind == 0:
            frame[:] = 0
        elif kind == 1:
            frame = rng.integers(0, 256, frame.shape).astype(np.uint8)
        elif kind == 2:
            frame = noise
        else:
            shift = k * (5 if kind == 3 else 1) if kind != 8 else round(3 * math.sin(k))
            patch = smooth if kind in (3, 4, 8) else texture if kind == 5 else np.full_like(texture, 200)
            top, left = height // 4, width // 4 + shift
            room = frame[top : top + patch.shape[0], left : left + patch.shape[1]]
            room[:] = patch[: room.shape[0], : room.shape[1]]
            if kind == 8:
                frame = np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8)
        frames.append(np.ascontiguousarray(frame))
    return frames


def _stamps(rng: np.random.Generator, count: int) -> list[int]:
    stamps = [START_NS + k * PERIOD_NS for k in range(count)]
    if rng.random() < 0.85:
        return stamps
    period = int(rng.choice([0, 1, 2, 1000, 10**9, 10**12, 10**17]))
    start = int(rng.choice([0, -(2**62), 2**62, START_NS, -(2**63), 2**63 - 1]))
    stamps = [start + k * period for k in range(count)]
    if stamps and rng.random() < 0.4:
        stamps[int(rng.integers(count))] = int(rng.choice([0, -1, 2**63 - 1, -(2**63), START_NS + 10**18]))
    return [stamps[i] for i in rng.permutation(count)] if rng.random() < 0.3 else stamps


def _camera(rng: np.random.Generator, width: int, height: int) -> Camera:
    pose = np.eye(4)
    pose[:3, 3] = rng.normal(0, 1, 3)
    named = {"world_from_camera": pose, "world_frame_id": "map"} if rng.random() < 0.5 else {}
    if rng.random() < 0.7:
        return camera_from_fov(float(rng.choice([1.0, 50.0, 170.0])), width, height, **named)
    k = np.array([1.2 * width, 0, width / 2, 0, 1.2 * height, height / 2, 0, 0, 1])
    if rng.random() < 0.1:
        k[int(rng.integers(9))] = float(rng.choice([*VALUES, 7.0, 1.0]))
    d = rng.normal(0, float(rng.choice([0.0, 0.0, 0.05, 10.0, 1e30])), int(rng.choice([0, 0, 1, 3, 4, 5, 8, 14, 20])))
    if len(d) and rng.random() < 0.05:
        d[0] = float(rng.choice(VALUES))
    camera = camera_from_info(k[: int(rng.choice([9] * 19 + [4]))], d, width, height, "optical", **named)
    undistort = undistorter(k, d, str(rng.choice(["plumb_bob", "rational_polynomial", "equidistant", "", "x" * 900])), width, height)
    if undistort is not None:
        assert undistort(np.zeros((height, width, 3), np.uint8)).shape == (height, width, 3)
    return camera


def _depths(rng: np.random.Generator, images: list[tuple[int, np.ndarray]], height: int, width: int) -> list[tuple[int, np.ndarray]]:
    """Depth as the decoder gives it: float32, 0 where unknown, finite."""
    if rng.random() < 0.6:
        return []
    value = float(rng.choice([0.5, 0.5, 0.5, 0.0, 1e-30, 1e30, 3e38]))
    plane = np.full((height, width), value, np.float32)
    how = int(rng.integers(4))
    if how == 1:
        plane = (plane * rng.uniform(0.9, 1.1, plane.shape)).astype(np.float32)
    elif how == 2:
        plane[rng.random(plane.shape) < 0.7] = 0
    return [(stamp, plane) for stamp, _ in images if rng.random() < rng.choice([1.0, 0.5])]


# -- masks and settings


def _mask(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    mask = np.zeros((height, width), np.uint8)
    how = int(rng.integers(13))
    if how == 0:
        mask[int(rng.integers(height)), int(rng.integers(width))] = int(rng.choice([1, 2, 255]))
    elif how == 1:
        mask[:] = int(rng.choice([0, 1, 2, 255]))
    elif how == 2:
        mask[:] = rng.integers(0, 256, mask.shape)
    elif how == 3:
        mask[:] = rng.integers(0, 3, mask.shape)
    elif how == 4:
        mask[height // 4 :, width // 4 :] = 255
        mask[height // 2 :, width // 2 :] = int(rng.choice([1, 0, 255]))
    elif how == 5:
        mask[::2, ::2] = 255
    elif how == 6:
        mask[height // 4 : 3 * height // 4, width // 4 :] = 1
        mask[height // 4 : 3 * height // 4, width // 2 :] = 2
        mask[0, 0] = int(rng.choice([0, 3]))
    elif how == 7:
        return np.zeros((height + 1, width), np.uint8)
    else:
        mask[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4] = 255
    return mask


def _settings(rng: np.random.Generator, folder: Path) -> config.Settings:
    values: dict[str, Any] = {"segment.method": str(rng.choice(["auto", "auto", "auto", "given", "motion", "otsu"]))}
    if rng.random() < 0.25:
        values["scene.first_mask"] = _mask_file(rng, folder)
    if rng.random() < 0.15:
        values["segment.box_px"] = rng.choice([-5.0, 0.0, 3.0, 12.0, 31.0, 1e9], 4).tolist()
    if rng.random() < 0.15:
        values["segment.point_px"] = rng.choice([-1.0, 0.0, 12.0, 23.0, 1e9], 2).tolist()
    if rng.random() < 0.2:
        values["scene.clamp_box_m"] = np.sort(rng.normal(0, 1, (2, 3)), 0).ravel().tolist()
    if rng.random() < 0.3:
        values["scene.thickness_axis"] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1e-9]][int(rng.integers(3))]
    values["segment.max_parts"] = int(rng.choice([1, 3, 8]))
    values["experiment.track_spacing_px"] = int(rng.choice([1, 2, 4, 64]))
    values["experiment.track_window_px"] = int(rng.choice([5, 9, 15, 63], p=[0.45, 0.25, 0.27, 0.03]))
    return config.build(values)


def _mask_file(rng: np.random.Generator, folder: Path) -> str:
    how = int(rng.integers(10))
    path = folder / str(rng.choice(["mask.png", "maske é.png"]))
    if how == 0:
        return str(rng.choice(["x" * 5000, "nothing.png", str(folder), "/dev/zero", "a" * 300]))
    if how == 1:
        os.mkfifo(path)
        return str(path)
    height, width = SIZES[int(rng.integers(len(SIZES)))]
    mask = _mask(rng, height, width)
    if how == 2:
        mask = mask.astype(np.uint16) * int(rng.choice([1, 257]))
    elif how == 3:
        mask = np.stack([mask] * 4, -1)
    data = cv2.imencode(".png", mask)[1].tobytes()
    if how == 4:
        data = data[: int(rng.integers(len(data)))]
    elif how == 5:
        data = rng.bytes(300)
    elif how == 6:  # a header that promises 10^9 pixels
        data = b"P5\n30000 30000\n255\n" + bytes(10)
    path.write_bytes(data)
    return str(path)
