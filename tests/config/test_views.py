"""Claims about config/diffphys.rviz and config/foxglove.json: every topic, type and field that they name is published."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import diffphys_ros
from diffphys_ros.bags.storage import typestore
from diffphys_ros.msg_schemas import TOPICS, clouds
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, CLOUD, DIAGNOSTICS, IMAGE, MARKERS, STATIC_TREE, WRENCH, absolute

CONFIG = Path(diffphys_ros.__file__).resolve().parent.parent / "config"
PUBLISHED = {"/" + absolute(name).lstrip("/"): topic for name, topic in TOPICS.items()}
CLICK = "/click"  # what segment_node listens to
LINES = ("/clamp_click", "/length_click")  # what all stages of a clip do
SHOWS = {"PointCloud2": CLOUD, "MarkerArray": MARKERS, "Wrench": WRENCH, "Camera": IMAGE, "Image": IMAGE}  # of rviz_default_plugins


@pytest.fixture(scope="module")
def rviz() -> dict[str, Any]:
    return yaml.safe_load((CONFIG / "diffphys.rviz").read_text())["Visualization Manager"]


@pytest.fixture(scope="module")
def foxglove() -> dict[str, Any]:
    return json.loads((CONFIG / "foxglove.json").read_text())


def displays(rviz: dict[str, Any]) -> list[dict[str, Any]]:
    return [display for display in rviz["Displays"] if "Topic" in display]


def test_rviz_shows_topics_of_the_table_by_their_type_and_hears_what_is_latched(rviz):
    assert len(displays(rviz)) >= 7
    for display in displays(rviz):
        topic = PUBLISHED[display["Topic"]["Value"]]
        assert topic.type_name == SHOWS[display["Class"].split("/")[1]], display["Name"]
        assert display["Topic"]["Durability Policy"] == ("Transient Local" if topic.latched else "Volatile")
        assert display["Topic"]["Reliability Policy"] == "Reliable"


def test_rviz_colours_by_fields_that_the_clouds_have(rviz):
    shown = [display for display in displays(rviz) if display["Class"].endswith("PointCloud2")]
    assert shown
    for display in shown:
        assert display["Channel Name"] in clouds.LAYOUTS[PUBLISHED[display["Topic"]["Value"]].name]


def test_rviz_finds_the_camera_of_an_image_beside_it_and_its_frame_in_the_tree(rviz):
    (camera,) = (display for display in displays(rviz) if display["Class"].endswith("Camera"))
    beside = PUBLISHED[camera["Topic"]["Value"].rsplit("/", 1)[0] + "/camera_info"]
    assert (beside.type_name, beside.frame) == (CAMERA_INFO, PUBLISHED[camera["Topic"]["Value"]].frame)
    assert rviz["Global Options"]["Fixed Frame"] == TOPICS[STATIC_TREE].frame


def test_a_point_that_is_clicked_in_a_viewer_reaches_segment_node(rviz, foxglove):
    tools = [tool["Topic"]["Value"] for tool in rviz["Tools"] if tool["Class"].endswith("PublishPoint")]
    assert tools == [CLICK, *LINES]
    assert foxglove["configById"]["3D!diffphys"]["publish"]["pointTopic"] == CLICK
    nodes = CONFIG.parent / "nodes"
    assert f'"{CLICK[1:]}"' in (nodes / "segment_node.py").read_text()
    assert all(f'"{line[1:]}"' in (nodes / "clicks.py").read_text() for line in LINES)


def test_foxglove_shows_topics_of_the_table_and_fields_that_they_have(foxglove):
    panels = foxglove["configById"]
    for topic, how in panels["3D!diffphys"]["topics"].items():
        assert topic in PUBLISHED
        if "colorField" in how:
            assert how["colorField"] in clouds.LAYOUTS[PUBLISHED[topic].name]
    for name in ("Image!rendered", "Image!clip"):
        mode = panels[name]["imageMode"]
        assert (PUBLISHED[mode["imageTopic"]].type_name, PUBLISHED[mode["calibrationTopic"]].type_name) == (IMAGE, CAMERA_INFO)
    for name, panel in panels.items():
        if name.startswith("DiagnosticSummary!"):
            assert PUBLISHED[panel["topicToRender"]].type_name == DIAGNOSTICS
    paths = [path["value"] for path in panels["Plot!force"]["paths"]]
    assert len(paths) == 3
    for path in paths:
        topic, *fields = path.split(".")
        assert has(PUBLISHED[topic].type_name, fields), path
    assert not has(WRENCH, ["wrench", "force", "w"])


def has(kind: str, fields: list[str]) -> bool:
    """Whether messages of a type have a field, named by the way to it."""
    for name in fields:
        inner = dict(typestore().fielddefs[kind][1]).get(name)
        if inner is None:
            return False
        kind = inner[1]
    return True


def test_every_panel_of_the_foxglove_layout_stands_in_it_once(foxglove):
    placed = list(leaves(foxglove["layout"]))
    assert sorted(placed) == sorted(foxglove["configById"])


def leaves(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from leaves(layout["first"])
        yield from leaves(layout["second"])
