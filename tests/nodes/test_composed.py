"""Claims about the nodes in one process."""

from __future__ import annotations

import signal

import pytest
import yaml

from diffphys_ros.errors import InputError
from diffphys_ros.nodes.composed import NODES, chosen

from .processes import Domain
from .recordings import recorded

CODE = "from diffphys_ros.nodes.executables import graph; graph()"


def test_a_node_can_be_left_out_and_what_is_no_node_is_refused() -> None:
    assert chosen([]) == list(NODES)
    assert chosen(["--without", "inspect_node", "--without", "splat_node"]) == ["ingest_node", "segment_node", "fit_node"]
    with pytest.raises(InputError, match="invalid choice: 'rviz'"):
        chosen(["--without", "rviz"])
    with pytest.raises(InputError, match="'bag' is no argument of it"):
        chosen(["bag"])


def test_one_process_takes_a_clip_from_a_played_recording_to_labels_and_ends_cleanly(made_clip, tmp_path) -> None:
    own = {"ingest_node": {"bag": str(recorded(tmp_path / "bag", made_clip)), "rate": 10.0}, "fit_node": {"out": str(tmp_path / "out")}}
    params = tmp_path / "params.yaml"
    params.write_text(yaml.safe_dump({f"/**/{name}": {"ros__parameters": each} for name, each in own.items()}))
    with Domain(tmp_path) as domain:
        domain.start("graph", "-X", "faulthandler", "-c", CODE, "--without", "inspect_node", "--ros-args", "--params-file", str(params), "-r", "__ns:=/robot1")
        domain.await_words("graph", "robot1.segment_node]: published 12 label images")
        assert domain.end("graph", signal.SIGINT) == 0
    assert (tmp_path / "out").is_dir()


def test_a_parameter_that_a_node_refuses_ends_the_process_with_its_sentence(tmp_path) -> None:
    with Domain(tmp_path) as domain:
        domain.start("graph", "-c", CODE, "--without", "inspect_node", "--ros-args", "-p", "bag:=/nowhere.mcap")
        assert domain.ended("graph") == 2
        assert "there is no such file or folder" in domain.said("graph")
