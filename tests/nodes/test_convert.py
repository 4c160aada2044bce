"""Claims about messages on the wire."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from diffphys_ros import config, msg_schemas
from diffphys_ros.msg_schemas import clouds, fields, messages
from diffphys_ros.msg_schemas.topics import TREE
from diffphys_ros.nodes.convert import message_class, to_ros


def test_every_published_message_survives_the_wire_with_checked_fields(made_recovery, made_clip):
    for message in msg_schemas.recording(made_recovery, made_clip, config.build({})):
        if message.type_name == TREE and not find_spec("tf2_msgs"):
            continue
        ready = to_ros(message.type_name, message.fields)
        assert deserialize_message(serialize_message(ready), message_class(message.type_name)) == ready
        if message.type_name.endswith("PointCloud2"):
            assert clouds.unpack(ready).tobytes() == clouds.unpack(message.fields).tobytes()


def test_numpy_numbers_become_plain_ones():
    ready = to_ros("std_msgs/msg/UInt32", {"data": np.int64(7)})
    assert type(ready.data) is int
    assert serialize_message(ready)


@pytest.mark.parametrize("level", [messages.OK, messages.WARN, messages.ERROR])
def test_diagnostic_levels_are_bytes(level):
    ready = to_ros("diagnostic_msgs/msg/DiagnosticArray", fields.progress(5, stage="fit", level=level))
    assert ready.status[0].level == bytes([level])
    assert messages.values_of(ready.status[0])["stage"] == "fit"


def test_camera_messages_carry_the_camera(made_clip):
    info = to_ros("sensor_msgs/msg/CameraInfo", messages.camera_info(messages.header(0, "c"), made_clip.camera))
    assert (np.reshape(info.k, (3, 3)) == made_clip.camera.pixel_from_camera).all()
    pose = to_ros("geometry_msgs/msg/TransformStamped", messages.camera_pose(0, made_clip.camera))
    assert pose.header.frame_id == "world"
    assert pose.child_frame_id == "camera_optical"
