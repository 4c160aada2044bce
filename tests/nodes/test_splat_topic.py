"""Claims about Gaussians on a topic."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.splat_topic import labels_crc_of, splat_cloud, splats_of
from diffphys_ros.splats.ply import FIELDS, from_raw, to_raw
from diffphys_ros.types import Splats

NAMES = ("mean", "rotation", "scale", "opacity", "color")


@pytest.fixture
def splats() -> Splats:
    """As a fit returns them: the values that their own raw form gives back."""
    rng = np.random.default_rng(2)
    rotation = rng.normal(size=(50, 4))
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    made = Splats(rng.normal(size=(50, 3)), rotation, rng.uniform(1e-3, 1e-2, (50, 3)), rng.uniform(0.1, 0.9, 50), rng.uniform(0, 1, (50, 3)))
    return from_raw(to_raw(made))


def test_the_topic_gives_the_raw_rows_back_bit_for_bit(splats):
    cloud = to_ros("sensor_msgs/msg/PointCloud2", splat_cloud(splats, messages.header(1, "world"), 5))
    received = splats_of(cloud)
    direct = from_raw(to_raw(splats))
    for name in NAMES:
        np.testing.assert_array_equal(getattr(received, name), getattr(direct, name))
    assert tuple(f.name for f in cloud.fields) == (*FIELDS, "labels")
    assert labels_crc_of(cloud) == 5


def test_a_cloud_without_all_fields_is_refused(splats):
    cloud = splat_cloud(splats, messages.header(1, "world"), 5)
    cloud["fields"] = [f for f in cloud["fields"] if f["name"] != "opacity"]
    with pytest.raises(InputError, match="opacity"):
        splats_of(cloud)
