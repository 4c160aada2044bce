"""Claims about Ray, on a cluster of two nodes on this machine. Skipped where Ray is not installed."""

from __future__ import annotations

import csv
import json
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from diffphys_ros.batch import Request, run_batch
from diffphys_ros.errors import InputError
from tests.quick_batch import QUICK_FLAGS, QUICK_WORDS, broken, child_of, wait_for

ray = pytest.importorskip("ray", reason="Ray is not installed; pip install ray")
pytestmark = [pytest.mark.slow, pytest.mark.faults]


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a cluster of two nodes of two cores."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_worker_niceness", "0")  # its workers are nice by 15, and starve on a machine that is busy with other tests
        made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        made.add_node(num_cpus=1)
    made.wait_for_nodes()
    yield made.address
    made.shutdown()


def test_a_worker_that_is_killed_in_the_middle_costs_a_second_attempt_and_no_row(cluster: str, half_sample: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = (str(half_sample / "clip.mcap"), str(broken(tmp_path / "spoiled")))
    killed: list[int] = []

    def kill_the_worker() -> None:
        folder = wait_for(lambda: next(iter(out.glob("half_sample*")), None))
        wait_for(lambda: (folder / "log.txt").exists() and (folder / "log.txt").stat().st_size > 200)  # it has got as far as the tracks
        child = wait_for(lambda: child_of(folder))
        worker = int(Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[1])
        os.kill(worker, signal.SIGKILL)
        killed.extend([worker, child])

    killer = threading.Thread(target=kill_the_worker, daemon=True)
    killer.start()
    assert run_batch(Request(clips=words, out=out, flags=QUICK_FLAGS, words=QUICK_WORDS, address=cluster)) == 1
    killer.join(1)
    assert len(killed) == 2
    wait_for(lambda: not Path(f"/proc/{killed[1]}").exists(), limit_s=20)
    rows = list(csv.DictReader((out / "summary.csv").open()))
    assert sorted(row["state"] for row in rows) == ["done", "failed"]
    assert [row["attempts"] for row in rows if row["state"] == "done"] == ["2"]
    statuses = [json.loads(path.read_text()) for path in out.glob("*/status.json")]
    assert len(statuses) == 2


def test_no_cluster_at_an_address_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no Ray cluster answers there"):
        run_batch(Request(clips=(str(broken(tmp_path / "spoiled")),), out=tmp_path / "out", address="127.0.0.1:1"))
