"""Claims about the whole job as real processes: one node with a bag, and five nodes fed by a sixth process."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.result import METRICS, RECOVERY

from .processes import Domain

# The same few iterations on both sides, on a coarse grid; a count that is given makes the fit forget the clock.
FEW = {"fit__iterations": 1, "particles__cells": 3, "particles__per_cell": 1.5, "splats__iterations": 3, "splats__max_count": 300}
FIT_S = 240.0  # with every kernel compiled for the first time


@pytest.fixture(scope="module")
def given() -> dict[str, object]:
    return {"config": sample_folder() / "given.yaml", **FEW}


@pytest.fixture(scope="module")
def one(tmp_path_factory, given):
    """fit_node with a bag, running on after its fit."""
    folder = tmp_path_factory.mktemp("one")
    with Domain(folder) as domain:
        domain.node("fit_node", bag=sample_folder() / "clip.mcap", out=folder / "out", **given)
        domain.await_words("fit_node", "done: results in", FIT_S)
        yield domain


@pytest.fixture(scope="module")
def heard(one):
    """What a subscriber that came after the fit received."""
    process = one.start("late", "-m", "diffphys_ros.nodes.listen", "--timeout", "30", "--out", str(one.folder / "late.npz"))
    assert process.wait(60) == 0, one.said("late")
    return np.load(one.folder / "late.npz")


@pytest.fixture(scope="module")
def recovered(one):
    return np.load(one.folder / "out" / RECOVERY)


def net_force(recovered) -> np.ndarray:
    return np.einsum("tnc,n->tc", recovered["force"].astype(float), recovered["volume"] * ~recovered["clamped"])


def test_a_late_subscriber_receives_the_net_force_of_every_frame(heard, recovered):
    net = net_force(recovered)
    assert np.abs(net).max() > 0
    np.testing.assert_allclose(heard["net_force"], net, atol=0.01 * np.linalg.norm(net, axis=1).max())
    np.testing.assert_allclose(heard["t"], np.arange(len(net)) * recovered["period_s"], atol=1e-5)


def test_a_late_subscriber_receives_the_modulus_of_every_particle(heard, recovered):
    np.testing.assert_allclose(heard["young"], recovered["young"], rtol=1e-6)
    np.testing.assert_array_equal(heard["part"], recovered["part"])


def test_a_late_subscriber_is_told_what_fixed_the_scale(one, heard):
    metrics = json.loads((one.folder / "out" / METRICS).read_text())
    for name in ("density_source", "metric_scale_source"):
        assert metrics[name]
        assert f"{name}: {metrics[name]}" in one.said("late")
    assert "net_force: playing" in one.said("late") or "force_field" in one.said("late")


@pytest.fixture(scope="module")
def five(tmp_path_factory, given):
    """The five nodes as five processes, fed by a sixth; started in an order in which everyone is late for someone."""
    folder = tmp_path_factory.mktemp("five")
    with Domain(folder) as domain:
        domain.start("camera", "-m", "diffphys_ros.nodes.replay", str(sample_folder() / "clip.mcap"))
        domain.node("ingest_node", reliability="reliable", silence_s=3.0, config=given["config"])
        domain.node("fit_node", out=folder / "out", **given)
        domain.node("splat_node", **given)
        domain.node("segment_node", **given)
        domain.node("inspect_node", file=folder / "all.rrd")
        domain.await_words("fit_node", "done: results in", FIT_S)
        time.sleep(0.5)  # for the last message to reach inspect_node
        assert domain.end_all() == dict.fromkeys(domain.running, 0)
        yield domain


def test_five_processes_end_with_the_fields_of_one_bit_for_bit(five, recovered):
    other = np.load(five.folder / "out" / RECOVERY)
    assert set(other.files) == set(recovered.files)
    different = [name for name in recovered.files if not np.array_equal(recovered[name], other[name], equal_nan=recovered[name].dtype.kind == "f")]
    assert different == []


def test_every_process_keeps_the_frames_it_was_sent(five):
    assert "published a clip of" in five.said("ingest_node")
    assert "lost in the recording" not in five.said("ingest_node")


def test_the_inspector_wrote_a_recording(five):
    assert (five.folder / "all.rrd").stat().st_size > 100_000


def test_one_process_ends_with_status_0_while_it_plays(one, recovered, heard):
    assert one.end_all()["fit_node"] == 0
