"""Claims about how a node ends, with real processes."""

from __future__ import annotations

import signal
import time

import pytest

from diffphys_ros.bags.sample import sample_folder

from .processes import Domain

INT, TERM = signal.SIGINT, signal.SIGTERM


@pytest.fixture(scope="module")
def nodes(tmp_path_factory):
    """Four fit nodes: two wait for topics, two work on the sample."""
    sample = sample_folder()
    with Domain(tmp_path_factory.mktemp("exit")) as domain:
        for kind, parameters in (("idle", {}), ("busy", {"bag": sample / "clip.mcap", "config": sample / "given.yaml"})):
            for which in ("int", "term"):
                domain.node("fit_node", name=f"{kind}_{which}", **parameters)
        yield domain


@pytest.mark.parametrize("kind", ["idle", "busy"])
@pytest.mark.parametrize(("which", "signals"), [("int", (INT, INT)), ("term", (TERM, TERM))])
def test_a_doubled_signal_ends_a_node_with_status_0(nodes, kind, which, signals):
    name = f"{kind}_{which}"
    nodes.await_words(name, "waiting for" if kind == "idle" else "segment: object mask", 90)
    assert nodes.end(name, *signals, gap_s=0.05) == 0
    assert "Traceback" not in nodes.said(name)


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
        process = domain.node("fit_node", **parameters)
        assert process.wait(30) == 2
        assert words in domain.said("fit_node")
        assert "Traceback" not in domain.said("fit_node")
