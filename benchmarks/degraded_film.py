"""A film made worse, without loss: blurred, or with noise.

usage: python benchmarks/degraded_film.py FILM.mp4 OUT.avi blur|noise     (standard deviation 2 px, or 5 grey levels alike in all channels)
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

BLUR_PX, NOISE = 2.0, 5.0


def blurred(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Of a frame (H, W, 3) uint8."""
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), BLUR_PX))


def noisy(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Of a frame (H, W, 3) uint8."""
    return np.clip(np.rint(frame + rng.normal(0, NOISE, frame.shape[:2])[..., None]), 0, 255).astype(np.uint8)


WORSE = {"blur": blurred, "noise": noisy}


def main(film: str, out: str, how: str) -> int:
    """Returns the exit status."""
    read, rng = cv2.VideoCapture(film), np.random.default_rng(0)
    size = int(read.get(cv2.CAP_PROP_FRAME_WIDTH)), int(read.get(cv2.CAP_PROP_FRAME_HEIGHT))
    written = cv2.VideoWriter(out, cv2.VideoWriter_fourcc(*"FFV1"), read.get(cv2.CAP_PROP_FPS), size)
    while True:
        there, frame = read.read()
        if not there:
            break
        written.write(WORSE[how](frame, rng))
    written.release()
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[3] not in WORSE:
        raise SystemExit(__doc__)
    sys.exit(main(*sys.argv[1:]))
