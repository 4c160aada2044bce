"""Qualities of service as recordings tell them, from any version of rosbag2: numbers or names, in YAML or plain."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

LATCHED_ANYWAY = "/tf_static"  # nobody who comes late could place a thing without it
MOST_CHARACTERS = 1 << 16  # of a topic's profiles
MOST_DEPTH = 1000


class Offer(NamedTuple):
    """What a publisher offers."""

    reliable: bool = True
    latched: bool = False  # transient local
    depth: int = 10  # of its history; 0: everything


def offer_of(topic: str, told: Iterable[Any]) -> Offer:
    """One offer that serves the subscribers of every recorded one; rosbag2's default where none can be read.

    `told`: unpacked.Unread of each of the topic's connections.
    """
    profiles = [profile for each in told for profile in _profiles(getattr(each, "told", None))]
    latched = topic == LATCHED_ANYWAY or any(_is(p, "durability", 1, "transient_local") for p in profiles)
    if not profiles:
        return Offer(latched=latched, depth=MOST_DEPTH if latched else Offer().depth)
    everything = any(_is(p, "history", 2, "keep_all") for p in profiles)
    depths = [p["depth"] for p in profiles if type(p.get("depth")) is int]
    return Offer(
        reliable=not all(_is(p, "reliability", 2, "best_effort") for p in profiles),
        latched=latched,
        depth=0 if everything else min(max(1, *depths, sum(depths) if latched else 1), MOST_DEPTH),
    )


def _profiles(told: Any) -> list[dict[str, Any]]:
    import yaml

    if isinstance(told, str):
        try:
            told = yaml.safe_load(told) if len(told) <= MOST_CHARACTERS else None
        except (yaml.YAMLError, RecursionError, ValueError):
            told = None
    return [profile for profile in told if isinstance(profile, dict)] if isinstance(told, list) else []


def _is(profile: dict[str, Any], key: str, number: int, name: str) -> bool:
    value = profile.get(key)
    return value == number if isinstance(value, int) else str(value).lower() == name
