"""Videos and folders of pictures that are broken: each is read as far as it goes, and said, or refused in one sentence."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.video import image_files, read_image
from diffphys_ros.errors import InputError

from .conftest import picture

SETTINGS = config.build({"camera.fps": 30.0, "camera.fov_deg": 60.0})


@pytest.fixture
def images(tmp_path: Path) -> Path:
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"bild ü{k}.png"), picture(k)[..., ::-1])
    return tmp_path


def broken(data: bytes) -> dict[str, bytes]:
    return {"cut": data[: len(data) // 2], "empty": b"", "noise": bytes(range(256)), "header": b"P5\n30000 30000\n255\n"}


@pytest.mark.parametrize("how", ["cut", "empty", "noise", "header"])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_folder_with_a_broken_picture_is_refused_with_its_name(images: Path, suffix: str, how: str) -> None:
    whole = cv2.imencode(suffix, np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8))[1].tobytes()
    (images / f"bild ü9{suffix}").write_bytes(broken(whole)[how])
    with pytest.raises(InputError, match=rf"bild ü9\{suffix}: ") as caught:
        read_clip(images, SETTINGS)
    assert len(str(caught.value)) < 400


def test_a_whole_jpeg_is_read_and_names_may_hold_any_letters(images: Path) -> None:
    cv2.imwrite(str(images / "bild ü9.jpg"), picture(9)[..., ::-1])
    assert len(read_clip(images, SETTINGS)) == 5


@pytest.mark.timeout(20)
def test_a_pipe_or_a_folder_among_the_pictures_is_refused(images: Path) -> None:
    os.mkfifo(images / "z.png")
    with pytest.raises(InputError, match=r"z\.png: no regular file"):
        read_clip(images, SETTINGS)
    (images / "z.png").unlink()
    (images / "z.png").mkdir()
    with pytest.raises(InputError, match=r"z\.png: no regular file"):
        read_clip(images, SETTINGS)


def test_a_picture_file_of_gigabytes_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "big.png").open("wb") as file:
        file.truncate(1 << 34)  # without blocks
    with pytest.raises(InputError, match="no regular file of at most 256 MiB"):
        read_image(tmp_path / "big.png")


def test_frames_of_changing_size_are_refused(images: Path) -> None:
    cv2.imwrite(str(images / "z.png"), np.zeros((5, 7, 3), np.uint8))
    with pytest.raises(InputError, match=r"a colour image has 7x5 px, must have the camera's 16x12 px"):
        read_clip(images, SETTINGS)


@pytest.mark.slow
def test_more_pictures_than_can_be_worked_on_are_refused_unread(tmp_path: Path) -> None:
    for k in range(5001):
        (tmp_path / f"{k}.png").touch()
    with pytest.raises(InputError, match="has more than 5000 frames"):
        read_clip(tmp_path, SETTINGS)
    assert [file.stem for file in image_files(tmp_path)[:3]] == ["0", "1", "2"]


@pytest.mark.timeout(20)
def test_a_playlist_that_has_not_ended_is_no_video_and_is_not_waited_for(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "segment.ts"), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (64, 48))
    for k in range(5):
        writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    writer.release()
    playlist = tmp_path / "clip.m3u8"
    playlist.write_text(f"#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:2\n#EXTINF:1,\n{tmp_path / 'segment.ts'}\n")
    with pytest.raises(InputError, match="holds no video that can be decoded"):
        read_clip(playlist, SETTINGS)


def test_a_video_that_is_cut_off_is_read_as_far_as_it_goes_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    for k in range(20):
        writer.write(np.random.default_rng(k).integers(0, 255, (48, 64, 3)).astype(np.uint8))
    writer.release()
    assert read_clip(path, SETTINGS).notes == ()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    clip = read_clip(path, SETTINGS)
    assert 2 <= len(clip) < 12
    assert any("of the 20 frames that the video announces can be decoded" in note for note in clip.notes)
