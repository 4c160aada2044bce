"""Which images are rectified, by the name of their topic."""

from __future__ import annotations

import pytest

from diffphys_ros.bags.lens import is_rectified


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/camera/color/image_rect", True),
        ("/left/image_rect_color", True),
        ("image_rect/compressed", True),
        ("/camera/depth/image_rect_raw", True),
        ("/camera/image_rectified", True),
        ("/camera/image_raw", False),
        ("/rect/image_raw", False),
        ("/camera/image_corrected", False),
        ("/camera/direct_image", False),
    ],
)
def test_a_topic_is_rectified_where_its_last_name_has_the_word(topic: str, rectified: bool) -> None:
    assert is_rectified(topic) == rectified
