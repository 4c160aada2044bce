"""Claims about qualities of service as recordings tell them."""

from __future__ import annotations

import pytest
import yaml

from diffphys_ros.bags.offers import MOST_CHARACTERS, Offer, offer_of
from diffphys_ros.bags.unpacked import Unread

NAMES = {"history": "keep_last", "depth": 5, "reliability": "best_effort", "durability": "volatile"}
NUMBERS = {"history": 1, "depth": 5, "reliability": 2, "durability": 2}


@pytest.mark.parametrize("profile", [NAMES, NUMBERS])
def test_names_and_numbers_of_any_version_say_the_same(profile) -> None:
    assert offer_of("/image", [Unread([profile])]) == offer_of("/image", [Unread(yaml.safe_dump([profile]))]) == Offer(reliable=False, latched=False, depth=5)


def test_what_is_offered_serves_the_subscribers_of_every_publisher() -> None:
    reliable, latched = NAMES | {"reliability": "reliable", "depth": 2}, NAMES | {"durability": "transient_local", "depth": 1}
    assert offer_of("/image", [Unread([NAMES]), Unread([reliable])]) == Offer(reliable=True, latched=False, depth=5)
    assert offer_of("/map", [Unread([latched, latched])]) == Offer(reliable=False, latched=True, depth=2)
    assert offer_of("/all", [Unread([NAMES | {"history": "keep_all"}])]).depth == 0


@pytest.mark.parametrize("told", [None, [], "", "[", "x: 1", 7, "[" * 2000, "a" * (MOST_CHARACTERS + 1), [7, None], [{"depth": "many"}]])
def test_what_cannot_be_read_is_offered_as_rosbag2_does_and_the_tree_is_latched_anyway(told) -> None:
    assert offer_of("/image", [Unread(told)])._replace(depth=10) == Offer()
    assert offer_of("/tf_static", [Unread(told)]).latched


def test_two_publishers_of_a_topic_are_equal_whoever_wrote_their_profiles() -> None:
    assert Unread([NAMES]) == Unread("anything")
