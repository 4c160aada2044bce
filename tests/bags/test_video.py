"""Videos and folders of pictures that are broken: each is read as far as it goes, and said, or refused in one sentence."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.video import image_files, read_image
from diffphys_ros.config import FrameSettings
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

from .conftest import picture

SETTINGS, OWN_TIMES = config.build({"camera.fps": 30.0, "camera.fov_deg": 60.0}), config.build({"camera.fov_deg": 60.0})


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


def mp4(path: Path, apart: list[tuple[int, int]]) -> Path:
    """A video of 25 frames a second whose frames, each of its own brightness, are shown so long (frames, how long each [1/25 s]): its table of
    times is written anew, and the boxes about it are made longer."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (64, 48))
    for k in range(sum(count for count, _ in apart)):
        writer.write(np.full((48, 64, 3), 10 * k, np.uint8))
    writer.release()
    data = bytearray(path.read_bytes())
    table = data.rfind(b"stts") - 4
    size, _, _, _, _, unit = struct.unpack_from(">I4sIIII", data, table)
    runs = b"".join(struct.pack(">II", count, unit * long) for count, long in apart)
    new = struct.pack(">I4sII", 16 + len(runs), b"stts", 0, len(apart)) + runs
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        at = data.rfind(name, 0, table) - 4
        struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + len(new) - size)
    data[table : table + size] = new
    path.write_bytes(bytes(data.replace(b"edts", b"free")))  # without the box that says how long all of it is
    return path


def brightness(clip: Clip) -> list[int]:
    return [round(x / 10) for x in clip.frames[:, 24, 32, 0].tolist()]


def test_frames_that_a_phone_left_out_shift_no_later_one(tmp_path: Path) -> None:
    path = mp4(tmp_path / "phone.mp4", [(6, 1), (1, 2), (5, 1), (2, 2), (6, 1)])
    clip = read_clip(path, OWN_TIMES)
    assert clip.period_s == pytest.approx(1 / 25)
    assert np.flatnonzero(~clip.seen).tolist() == [7, 14, 16]
    assert [k for k, seen in zip(brightness(clip), clip.seen, strict=True) if seen] == list(range(20))
    assert any("the video's frames are 40 to 80 ms apart: each is taken at its own time" in note for note in clip.notes)
    thinned = read_clip(path, OWN_TIMES, frames=FrameSettings(every=3))
    assert brightness(thinned) == [0, 3, 6, 8, 11, 13, 15, 18]
    assert thinned.period_s == pytest.approx(3 / 25)


def test_a_rate_that_is_told_goes_before_the_times_of_a_video(tmp_path: Path) -> None:
    clip = read_clip(mp4(tmp_path / "phone.mp4", [(6, 1), (1, 2), (5, 1)]), SETTINGS)
    assert clip.seen.all()
    assert clip.period_s == pytest.approx(1 / 30)
    assert clip.notes == ()
