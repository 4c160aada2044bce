"""Recordings, videos and image folders to clips; what cannot be read is refused in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.storage import typestore
from diffphys_ros.bags.write import to_message
from diffphys_ros.errors import InputError

from .conftest import (
    FRAME,
    HEIGHT,
    PERIOD_NS,
    START_NS,
    WIDTH,
    colour_topic,
    depth_topic,
    distance,
    header,
    image,
    info_topic,
    picture,
    png_topic,
    tree_topic,
)

Record = Callable[..., Path]
DEFAULT = config.Settings()
ZSTD_MAGIC = bytes.fromhex("28b52ffd")


def settings(**values: Any) -> config.Settings:
    return config.build({name.replace("__", "."): value for name, value in values.items()})


def test_a_bag_gives_its_frames_depth_camera_and_pose(record: Record) -> None:
    tree = tree_topic({FRAME: ("mast", (0, 0, 1.5)), "mast": ("map", (2, 0, 0))})
    clip = read_clip(record(colour_topic(), depth_topic(), info_topic(), tree), settings(scene__gravity_m_s2=[0.0, 0.0, -9.81]))
    np.testing.assert_array_equal(clip.frames, [picture(k) for k in range(6)])
    assert clip.depth is not None
    np.testing.assert_allclose(clip.depth, [distance(k) / 1000 for k in range(6)], rtol=1e-6)
    assert (clip.start_ns, clip.camera.focal_px, clip.notes) == (START_NS, 20.0, ())
    assert clip.period_s == pytest.approx(PERIOD_NS * 1e-9, rel=1e-9)
    assert (clip.camera.frame_id, clip.camera.world_frame_id) == (FRAME, "map")
    np.testing.assert_allclose(clip.camera.position, [2, 0, 1.5])


def test_compressed_colour_reads_like_raw(record: Record) -> None:
    np.testing.assert_array_equal(read_clip(record(png_topic(), info_topic()), DEFAULT).frames, [picture(k) for k in range(6)])


def test_a_bag_without_depth_and_transforms_is_in_the_cameras_frame(record: Record) -> None:
    clip = read_clip(record(colour_topic(), info_topic()), DEFAULT)
    assert clip.depth is None
    assert clip.camera.world_frame_id == clip.camera.frame_id == FRAME


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_rosbag2_folders_read_like_a_single_file(record: Record, tmp_path: Path, plugin: StoragePlugin) -> None:
    messages = [*colour_topic(), *depth_topic(), *info_topic()]
    with Writer(tmp_path / "folder", version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, ns, fields, _ in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=typestore())
            writer.write(connections[topic], ns, typestore().serialize_cdr(to_message(kind, fields), kind))
    one, other = read_clip(record(iter(messages)), DEFAULT), read_clip(tmp_path / "folder", DEFAULT)
    np.testing.assert_array_equal(one.frames, other.frames)
    np.testing.assert_array_equal(one.depth, other.depth)
    assert one.period_s == other.period_s


def test_depth_can_be_left_out(record: Record) -> None:
    assert read_clip(record(colour_topic(), depth_topic(), info_topic()), settings(topics__depth="none")).depth is None


def test_two_colour_topics_are_listed_and_one_can_be_named(record: Record) -> None:
    path = record(colour_topic("/left/image"), colour_topic("/right/image", frames=4), info_topic())
    with pytest.raises(InputError, match=r"several topics could be the image: /left/image, /right/image; name one with topics.image"):
        read_clip(path, DEFAULT)
    assert len(read_clip(path, settings(topics__image="/right/image"))) == 4


def test_two_depth_topics_are_listed(record: Record) -> None:
    with pytest.raises(InputError, match=r"could be the depth: /d1, /d2"):
        read_clip(record(colour_topic(), depth_topic("/d1"), depth_topic("/d2"), info_topic()), DEFAULT)


def test_the_camera_info_beside_the_images_is_taken(record: Record) -> None:
    infos = info_topic("/color/camera_info"), info_topic("/depth/camera_info", k=[99.0, 0, 0, 0, 99, 0, 0, 0, 1])
    path = record(colour_topic("/color/image_raw"), *infos)
    assert read_clip(path, DEFAULT).camera.focal_px == 20.0
    assert read_clip(path, settings(topics__camera_info="/depth/camera_info")).camera.focal_px == 99.0


def test_two_camera_infos_elsewhere_are_listed(record: Record) -> None:
    with pytest.raises(InputError, match=r"could be the camera_info: /a/camera_info, /b/camera_info"):
        read_clip(record(colour_topic("/image"), info_topic("/a/camera_info"), info_topic("/b/camera_info")), DEFAULT)


@pytest.mark.parametrize("topic", ["/nowhere", "/camera/camera_info"])
def test_a_named_topic_that_has_no_images_is_refused_with_those_that_have(record: Record, topic: str) -> None:
    with pytest.raises(InputError, match=r"topics.image is .*, must be one of /camera/image_raw"):
        read_clip(record(colour_topic(), info_topic()), settings(topics__image=topic))


def test_a_depth_topic_named_as_colour_is_refused(record: Record) -> None:
    with pytest.raises(InputError, match=r"/camera/depth/image_raw holds no colour images"):
        read_clip(record(colour_topic(), depth_topic(), info_topic()), settings(topics__image="/camera/depth/image_raw"))


def test_lens_distortion_is_removed_and_said(record: Record) -> None:
    clip = read_clip(record(colour_topic(), info_topic(d=[-0.3, 0.1, 0, 0, 0])), DEFAULT)
    assert "lens distortion was removed from the images" in clip.notes
    assert not np.array_equal(clip.frames[0], picture(0))


def test_rectified_images_use_the_projection_matrix_and_are_left_alone(record: Record) -> None:
    info = info_topic(d=[-0.3, 0.1, 0, 0, 0], p=[30.0, 0, 7, 0, 0, 30, 5, 0, 0, 0, 1, 0])
    clip = read_clip(record(colour_topic("/camera/image_rect"), info), DEFAULT)
    assert clip.camera.focal_px == 30.0
    np.testing.assert_array_equal(clip.frames[0], picture(0))


def test_images_without_stamps_take_the_times_of_recording(record: Record) -> None:
    bare = ((topic, kind, ns, fields | {"header": header(0)}, latched) for topic, kind, ns, fields, latched in colour_topic())
    clip = read_clip(record(bare, info_topic()), DEFAULT)
    assert clip.start_ns == START_NS
    assert "carry no stamp" in clip.notes[0]


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing.mcap: there is no such file or folder"):
        read_clip(tmp_path / "nothing.mcap", DEFAULT)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.99])
def test_a_truncated_mcap_is_refused_wherever_it_ends(record: Record, share: float) -> None:
    path = record(colour_topic(), depth_topic(), info_topic())
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=r"clip.mcap: not a complete ROS 2 recording \(.*mcap recover"):
        read_clip(path, DEFAULT)


def test_a_damaged_chunk_is_refused(record: Record) -> None:
    path = record(colour_topic(), info_topic())
    data = bytearray(path.read_bytes())
    start = data.index(ZSTD_MAGIC)
    data[start : start + 16] = bytes(16)
    path.write_bytes(data)
    with pytest.raises(InputError, match="not a complete ROS 2 recording"):
        read_clip(path, DEFAULT)


def test_a_bag_without_camera_info_needs_a_field_of_view(record: Record) -> None:
    path = record(colour_topic())
    with pytest.raises(InputError, match=r"has no camera_info; record the camera_info topic or set camera.fov_deg"):
        read_clip(path, DEFAULT)
    clip = read_clip(path, settings(camera__fov_deg=60.0))
    assert 2 * np.degrees(np.arctan(WIDTH / 2 / clip.camera.focal_px)) == pytest.approx(60)


def test_a_zero_focal_length_is_refused(record: Record) -> None:
    with pytest.raises(InputError, match=r"/camera/camera_info: camera_info has focal length K\[0\] = 0, must be above 0"):
        read_clip(record(colour_topic(), info_topic(k=np.zeros(9))), DEFAULT)


def test_a_camera_info_for_another_size_is_refused(record: Record) -> None:
    with pytest.raises(InputError, match=r"is for 640x480 px, the images of /camera/image_raw have 16x12 px"):
        read_clip(record(colour_topic(), info_topic(width=640, height=480)), DEFAULT)


def test_one_frame_is_refused(record: Record) -> None:
    with pytest.raises(InputError, match=r"has 1 colour frame\(s\), at least 2"):
        read_clip(record(colour_topic(frames=1), info_topic()), DEFAULT)


def test_an_unknown_encoding_is_refused(record: Record) -> None:
    odd = [("/camera/image_raw", "sensor_msgs/msg/Image", START_NS, image(START_NS, picture(0), "nv21"), False)]
    with pytest.raises(InputError, match=r"no colour images found \(image topics of unknown encoding: /camera/image_raw \(nv21\)\)"):
        read_clip(record(iter(odd), info_topic()), DEFAULT)
    with pytest.raises(InputError, match=r"/camera/image_raw: image encoding 'nv21' is unknown"):
        read_clip(record(iter(odd), info_topic()), settings(topics__image="/camera/image_raw"))


@pytest.mark.parametrize("fill", [np.nan, 0.0])
def test_depth_of_nan_alone_is_refused(record: Record, fill: float) -> None:
    with pytest.raises(InputError, match=r"no finite value above 0; set topics.depth to 'none'"):
        read_clip(record(colour_topic(), depth_topic(fill=fill), info_topic()), DEFAULT)


def test_a_bag_without_images_is_refused_with_its_topics(record: Record) -> None:
    with pytest.raises(InputError, match=r"no colour images found \(topics: /camera/camera_info\)"):
        read_clip(record(info_topic()), DEFAULT)


def test_a_ros_1_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0")
    with pytest.raises(InputError, match="a ROS 1 bag"):
        read_clip(tmp_path / "old.bag", DEFAULT)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    for k in range(5):
        writer.write(np.full((48, 64, 3), (40 * k, 0, 0), np.uint8))  # blue grows
    writer.release()
    return path


def test_a_video_assumes_a_field_of_view_and_says_so(video: Path) -> None:
    clip = read_clip(video, DEFAULT)
    assert len(clip) == 5
    assert clip.period_s == pytest.approx(0.04)
    assert 2 * np.degrees(np.arctan(32 / clip.camera.focal_px)) == pytest.approx(50)
    assert "50 degrees are assumed" in clip.notes[0]
    np.testing.assert_allclose(clip.frames[:, 24, 32, 2], 40 * np.arange(5), atol=6)


def test_a_given_field_of_view_and_rate_are_used_for_a_video(video: Path) -> None:
    clip = read_clip(video, settings(camera__fov_deg=70.0, camera__fps=50.0))
    assert clip.period_s == pytest.approx(0.02)
    assert clip.notes == ()


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"text")
    with pytest.raises(InputError, match=r"clip.mp4: holds no video that can be decoded"):
        read_clip(tmp_path / "clip.mp4", DEFAULT)


@pytest.fixture
def images(tmp_path: Path) -> Path:
    for k in range(11):
        cv2.imwrite(str(tmp_path / f"frame{k}.png"), picture(k)[..., ::-1])
    return tmp_path


def test_a_folder_of_images_is_read_in_the_order_of_its_numbers(images: Path) -> None:
    clip = read_clip(images, settings(camera__fps=30.0))
    np.testing.assert_array_equal(clip.frames, [picture(k) for k in range(11)])
    assert clip.period_s == pytest.approx(1 / 30, rel=1e-6)
    assert clip.camera.height == HEIGHT


def test_a_folder_with_a_recording_in_it_is_not_taken_for_its_pictures(images: Path) -> None:
    (images / "clip.mcap").touch()
    with pytest.raises(InputError, match=r"holds recordings \('?clip.mcap'?\) .* give one of them"):
        read_clip(images, settings(camera__fps=30.0))


def test_a_folder_of_images_needs_a_rate(images: Path) -> None:
    with pytest.raises(InputError, match=r"state no frame rate; set camera.fps"):
        read_clip(images, DEFAULT)


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a folder without metadata.yaml"):
        read_clip(tmp_path, settings(camera__fps=30.0))


def test_a_damaged_image_is_named(images: Path) -> None:
    (images / "frame5.png").write_bytes(b"\x89PNG cut")
    with pytest.raises(InputError, match=r"frame5.png: .*cannot be decoded"):
        read_clip(images, settings(camera__fps=30.0))


def test_a_part_of_a_recording_is_read(record: Callable[..., Path]) -> None:
    path = record(colour_topic(), depth_topic(), info_topic())
    whole, part = read_clip(path, DEFAULT), read_clip(path, DEFAULT, start_s=1.5 * PERIOD_NS * 1e-9, duration_s=3 * PERIOD_NS * 1e-9)
    np.testing.assert_array_equal(part.frames, whole.frames[2:5])
    np.testing.assert_array_equal(part.depth, whole.depth[2:5])
    assert part.start_ns == START_NS + 2 * PERIOD_NS


@pytest.mark.parametrize(("part", "words"), [({"start_s": 5.0}, "start 5 s lies behind its end"), ({"start_s": 0.1, "duration_s": 0.01}, "holds no image between start")])
def test_a_part_without_images_is_refused(record: Callable[..., Path], part: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_clip(record(colour_topic(), info_topic()), DEFAULT, **part)


def test_only_recordings_are_read_in_part(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no recording, of which alone a part can be read"):
        read_clip(tmp_path, DEFAULT, start_s=1.0)


def test_what_is_told_of_the_world_is_taken_in_the_cameras_frame_of_a_video_and_said(video: Path) -> None:
    clip = read_clip(video, settings(camera__fov_deg=70.0, scene__gravity_m_s2=[0.0, 9.81, 0.0]))
    assert clip.notes == ("pictures carry no transforms: scene.gravity_m_s2 is taken in the camera's own frame, x right, y down, z forward",)
    with pytest.raises(InputError, match=r"scene.target_frame is map, but pictures carry no transforms"):
        read_clip(video, settings(scene__target_frame="map"))
