"""Claims about how a node ends, with real processes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from .processes import ROOT, Domain

pytestmark = pytest.mark.faults
INT, TERM = signal.SIGINT, signal.SIGTERM


@pytest.mark.parametrize("signals", [(INT, INT), (TERM, TERM)])
@pytest.mark.parametrize("busy", [False, True])
def test_a_doubled_signal_ends_a_node_with_status_0(half_sample, tmp_path, busy, signals):
    bag = {"bag": half_sample / "clip.mcap", "config": half_sample / "given.yaml"} if busy else {}
    with Domain(tmp_path) as domain:
        domain.node("fit_node", **bag)
        domain.await_words("fit_node", "segment: object mask" if busy else "waiting for")
        assert domain.end("fit_node", *signals, gap_s=0.05) == 0
        assert "Traceback" not in domain.said("fit_node")


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="this system has no /dev/shm")
def test_a_node_that_ends_leaves_nothing_in_shared_memory(tmp_path):
    """33 MB for each end of each node would fill a robot's memory."""
    with Domain(tmp_path) as domain:
        node = domain.node("ingest_node")
        domain.await_words("ingest_node", "waiting for")
        mapped = {Path(line.split()[-1]) for line in Path(f"/proc/{node.pid}/maps").read_text().splitlines() if "/dev/shm/fast" in line}  # Fast DDS
        own = {path for path in mapped if "_port" not in path.name}  # ports (52 kB) are shared, and stay where any of their users was killed
        assert own
        assert domain.end("ingest_node", INT) == 0
        assert not [path for path in own if path.exists()]


@pytest.mark.parametrize("number", [INT, TERM])
@pytest.mark.parametrize("after_s", [0.3, 0.8])
def test_a_signal_while_starting_ends_a_node_with_status_0(tmp_path, number, after_s):
    with Domain(tmp_path) as domain:
        domain.node("segment_node")
        time.sleep(after_s)
        assert domain.end("segment_node", number) == 0
        assert "Traceback" not in domain.said("segment_node")


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"bag": "/nowhere.mcap"}, "/nowhere.mcap: there is no such file"),
        ({"fit__iteratoins": 3}, "unknown setting 'fit.iteratoins'"),
        ({"out": "/proc/nowhere"}, "output folder /proc/nowhere"),
        ({"scene__gravity_m_s2": "[0, 0, -9.81]"}, "numbers of a list need one type"),
    ],
)
def test_bad_input_ends_a_node_with_status_2_and_one_sentence(tmp_path, parameters, words):
    with Domain(tmp_path) as domain:
        domain.node("fit_node", **parameters)
        assert domain.ended("fit_node") == 2
        assert words in domain.said("fit_node")
        assert "Traceback" not in domain.said("fit_node")


def test_a_fit_that_fails_ends_the_process_with_status_1_where_that_is_asked_for(tmp_path):
    (tmp_path / "clip.mcap").write_bytes(b"no recording")
    with Domain(tmp_path) as domain:
        domain.node("fit_node", bag=tmp_path / "clip.mcap", exit_when_done="true")
        assert domain.ended("fit_node") == 1
        assert domain.said("fit_node").count("not a complete ROS 2 recording") == 1
        assert "Traceback" not in domain.said("fit_node")


@pytest.mark.skipif(find_spec("rerun") is not None, reason="rerun-sdk is installed")
def test_without_rerun_the_inspector_says_what_to_install(tmp_path):
    with Domain(tmp_path) as domain:
        domain.node("inspect_node")
        assert domain.ended("inspect_node") == 2
        assert "needs the package 'rerun'; install" in domain.said("inspect_node")


def test_no_node_waits_for_torch_before_it_answers():
    nodes = ["ingest_node", "segment_node", "splat_node", "fit_node", "inspect_node"]
    code = f"import importlib, sys; [importlib.import_module('diffphys_ros.nodes.' + n) for n in {nodes}]; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0
