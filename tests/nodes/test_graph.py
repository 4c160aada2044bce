"""Claims about the whole job as real processes: five nodes fed by a sixth process, against one with a bag."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.result import METRICS, RECOVERY

from .processes import FIT_S, Domain

WITH_RERUN = find_spec("rerun") is not None
ANSWER = ("splats", "~/material_field", "~/force_field", "~/quality")


@pytest.fixture(scope="module")
def five(tmp_path_factory, half_sample, resumed):
    """The five nodes as five processes, fed by a sixth and heard by a seventh; started in an order in which everyone is late for someone."""
    folder = tmp_path_factory.mktemp("five")
    given = {"config": resumed.config}  # the same files of settings for every node, whatever it reads of them
    with Domain(folder) as domain:
        domain.start("camera", "-m", "diffphys_ros.nodes.replay", str(half_sample / "clip.mcap"), "--inputs")
        domain.node("ingest_node", reliability="reliable", silence_s=6.0, **given)
        domain.node("fit_node", out=folder / "out", **given)
        domain.node("splat_node", **given)
        domain.node("segment_node", **given)
        if WITH_RERUN:
            domain.node("inspect_node", file=folder / "all.rrd")
        domain.await_words("fit_node", "done: results in", FIT_S)
        domain.start("late", "-m", "diffphys_ros.nodes.listen", "--out", str(folder / "late.npz"))
        assert domain.ended("late") == 0, domain.said("late")
        for topic in ANSWER if WITH_RERUN else ():
            domain.await_words("inspect_node", f"showing {topic}")
        assert domain.end_all() == dict.fromkeys(domain.running, 0)  # fit_node while it plays
        yield domain


@pytest.fixture(scope="module")
def heard(five):
    """What a subscriber that came after the fit received."""
    return np.load(five.folder / "late.npz")


@pytest.fixture(scope="module")
def recovered(five):
    return np.load(five.folder / "out" / RECOVERY)


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


def test_a_late_subscriber_is_told_what_fixed_the_scale(five):
    metrics = json.loads((five.folder / "out" / METRICS).read_text())
    for name in ("density_source", "metric_scale_source"):
        assert metrics[name]
        assert f"{name}: {metrics[name]}" in five.said("late")
    assert "net_force: playing" in five.said("late") or "force_field" in five.said("late")


def test_five_processes_end_with_the_fields_of_one_bit_for_bit(recovered, resumed):
    """Also where the one was interrupted and went on."""
    one = np.load(resumed.out / RECOVERY)
    assert set(recovered.files) == set(one.files)
    different = [name for name in one.files if not np.array_equal(one[name], recovered[name], equal_nan=one[name].dtype.kind == "f")]
    assert different == []


def test_every_process_keeps_the_frames_it_was_sent(five, resumed):
    frames = len(np.load(resumed.out / RECOVERY)["stamps_ns"])
    assert f"published a clip of {frames} frames" in five.said("ingest_node")
    assert "lost in the recording" not in five.said("ingest_node")


@pytest.mark.skipif(not WITH_RERUN, reason="rerun-sdk is not installed")
def test_the_inspector_recorded_what_it_was_sent(five):
    command = shutil.which("rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    listing = subprocess.run([command, "rrd", "print", str(five.folder / "all.rrd")], capture_output=True, text=True, check=True).stdout
    for entity in ("world/camera/image/input", "world/object", "world/force", "world/splats", "net_force/z"):
        assert f"/{entity}" in listing, entity
