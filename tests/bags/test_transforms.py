"""A transform tree over time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from diffphys_ros.bags.transforms import HELD, MAX_LINKS, MAX_SAMPLES, MOVING, REACH_NS, STATIC, Transforms
from diffphys_ros.bags.write import to_message
from diffphys_ros.errors import InputError
from tests.filmed import POSE, link, pose

S = 10**9


def known(*links: tuple[str, str, np.ndarray, int, str]) -> Transforms:
    transforms = Transforms()
    for parent, child, matrix, ns, kind in links:
        transforms.add(message(parent, child, matrix, ns), kind)
    return transforms


def message(parent: str, child: str, matrix: np.ndarray, ns: int = 0) -> Any:
    return to_message(POSE, link(parent, child, matrix, ns))


def test_a_pose_is_the_product_of_the_chain_up_to_the_root() -> None:
    tree = known(("base", "camera", pose(2, 0, 0), 0, STATIC), ("map", "base", pose(0, 0, 1, turn_deg=(0, 0, 90)), 0, STATIC))
    assert tree.root("camera") == "map"
    np.testing.assert_allclose(tree.between("map", "camera") @ [1, 0, 0, 1], [0, 3, 1, 1], atol=1e-12)


def test_frames_that_share_an_ancestor_are_connected_and_others_are_not() -> None:
    tree = known(("base", "camera", pose(1, 0, 0), 0, STATIC), ("base", "imu", pose(0, 2, 0, turn_deg=(0, 0, 90)), 0, STATIC))
    np.testing.assert_allclose(tree.between("imu", "camera") @ [0, 0, 0, 1], [-2, -1, 0, 1], atol=1e-12)
    np.testing.assert_allclose(tree.between("imu", "camera") @ tree.between("camera", "imu"), np.eye(4), atol=1e-12)
    assert tree.between("camera", "elsewhere") is None


def test_a_leading_slash_is_no_part_of_a_name() -> None:
    tree = known(("/map", "/camera", pose(1, 2, 3), 0, STATIC))
    assert tree.root("camera") == "map"
    np.testing.assert_array_equal(tree.between("map", "/camera")[:3, 3], [1, 2, 3])


def test_a_moving_link_is_interpolated_at_a_constant_rate() -> None:
    tree = known(("map", "camera", pose(0, 0, 0), S, MOVING), ("map", "camera", pose(1, 0, 0, turn_deg=(0, 0, 80)), 2 * S, MOVING))
    np.testing.assert_allclose(tree.between("map", "camera", S + S // 4), pose(0.25, 0, 0, turn_deg=(0, 0, 20)), atol=1e-9)


def test_a_moving_link_says_nothing_of_other_times_and_camera_pose_holds_for_ever() -> None:
    samples = ("map", "camera", pose(1, 0, 0), S), ("map", "camera", pose(2, 0, 0), 2 * S)
    moving, held = (known(*((*each, kind) for each in samples)) for kind in (MOVING, HELD))
    assert moving.between("map", "camera", 2 * S + REACH_NS + 1) is None
    assert moving.between("map", "camera", S - REACH_NS - 1) is None
    assert moving.between("map", "camera", S - REACH_NS)[0, 3] == 1
    assert held.between("map", "camera", 1000 * S)[0, 3] == 2
    assert held.between("map", "camera", 0)[0, 3] == 1
    assert moving.between("map", "camera")[0, 3] == 2  # the latest, without a time


def test_the_latest_static_transform_counts_at_every_time() -> None:
    tree = known(("map", "camera", pose(1, 0, 0), 5 * S, STATIC), ("map", "camera", pose(2, 0, 0), 6 * S, STATIC))
    assert tree.between("map", "camera", 0)[0, 3] == 2


def test_samples_may_come_in_any_order() -> None:
    tree = known(*(("map", "camera", pose(k, 0, 0), k * S // 4, MOVING) for k in (3, 1, 2, 0)))
    assert tree.between("map", "camera", S // 8)[0, 3] == pytest.approx(0.5)


def test_a_joint_that_stands_still_for_hours_takes_two_samples_and_one_that_moves_no_more_than_the_bound() -> None:
    still = known(*(("map", "camera", pose(1, 0, 0), k * S // 50, MOVING) for k in range(1000)))
    assert len(still._links["camera"].stamps) == 2
    assert still.between("map", "camera", 10 * S)[0, 3] == 1
    moving = known(*(("map", "camera", pose(k, 0, 0), k * S // 50, MOVING) for k in range(MAX_SAMPLES + 100)))
    assert len(moving._links["camera"].stamps) == MAX_SAMPLES


def test_a_single_link_is_handed_on_as_it_was_received_where_it_stands_still() -> None:
    tree = known(("map", "camera", pose(1, 0, 0), S, HELD))
    assert tree.single("camera", "map").transform.translation.x == 1
    tree.add(message("map", "camera", pose(1, 0, 0), 2 * S), HELD)
    assert tree.single("camera", "map") is not None  # said again
    tree.add(message("map", "camera", pose(2, 0, 0), 3 * S), HELD)
    assert tree.single("camera", "map") is None
    assert known(("map", "camera", pose(1, 0, 0), S, MOVING)).single("camera", "map") is None


def test_a_circle_of_transforms_is_refused_and_not_kept() -> None:
    tree = known(("base", "camera", np.eye(4), 0, STATIC))
    with pytest.raises(InputError, match="base <- camera <- base form a circle"):
        tree.add(message("camera", "base", np.eye(4)), STATIC)
    assert tree.root("camera") == "base"


def test_absurd_chains_are_refused() -> None:
    far = pose(9e5, 0, 0)
    tree = known(("1", "0", far, 0, STATIC), ("2", "1", far, 0, STATIC))
    with pytest.raises(InputError, match=r"transforms: 0 lies .* m from 2, must be nearer than"):
        tree.between("2", "0")
    many = known(*(("map", str(k), np.eye(4), 0, STATIC) for k in range(MAX_LINKS)))
    with pytest.raises(InputError, match="1000 links"):
        many.add(message("map", "one more", np.eye(4)), STATIC)
