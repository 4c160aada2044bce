"""Claims about the memory that a node says it holds."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.msg_schemas import TOPICS
from diffphys_ros.nodes.child import steps
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_stage import Assembled
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.memory import give_back, held_mib, resident_mib_of
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.shared import place_of, shared_zeros
from diffphys_ros.nodes.splat_node import SplatNode
from diffphys_ros.types import Clip

from .processes import PATIENCE_S

HOLES = """
import sys
from diffphys_ros.nodes.memory import give_back_always, resident_mib_of
give_back_always()
pieces = [bytes(60_000) for _ in range(4000)]
full, pieces = resident_mib_of('self'), [bytes(60_000)]
print(full, flush=True)
sys.stdin.read()
"""
HELD = "import sys; held = bytearray(b'x') * (100 << 20); print('ready', flush=True); sys.stdin.read()"


def summed(array: np.ndarray):
    """In the other process."""
    yield int(array.sum(dtype=np.int64))
    while True:
        time.sleep(0.01)


def of_self(what: str, file: str = "smaps_rollup") -> float:
    """A row [kB] of a file of this process in /proc, in MiB."""
    return int(re.search(rf"^{what}:\s+(\d+)", Path("/proc/self", file).read_text(), re.MULTILINE)[1]) / 1024  # type: ignore[index]


def test_what_is_held_now_counts_and_what_a_child_holds_too():
    give_back()  # what other tests left
    before = held_mib()
    held = bytearray(b"x") * (100 << 20)
    assert 90 < held_mib() - before < 130
    del held
    give_back()
    assert held_mib() - before < 30
    with subprocess.Popen([sys.executable, "-c", HELD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert 90 < held_mib() - before < 160
        child.communicate("")
    assert held_mib() - before < 30


def test_small_pieces_go_back_to_the_system():
    """Those that the C library's allocator would keep: a hole of them below one that is still held."""
    before = held_mib()
    pieces = [bytes(60_000) for _ in range(2000)]
    last = bytes(60_000)
    assert held_mib() - before > 80
    del pieces
    give_back()
    assert held_mib() - before < 30
    assert last


def test_holes_between_small_pieces_go_back_while_the_work_goes_on():
    with subprocess.Popen([sys.executable, "-c", HOLES], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        full = float(child.stdout.readline())
        end = time.monotonic() + PATIENCE_S
        while resident_mib_of(child.pid) > full - 150:
            assert time.monotonic() < end
            time.sleep(0.1)
        child.communicate("")


def test_what_is_shared_is_there_once_and_counts_once():
    array = shared_zeros((100 << 20,), np.uint8)
    array[:] = 1
    give_back()
    before, mapped = held_mib(), of_self("Pss_Shmem")
    work = steps(summed, array)
    assert next(said for said in work if said is not None) == array.nbytes
    assert of_self("Pss_Shmem") == pytest.approx(mapped - 50, abs=1)  # half of it counts for the other process
    assert held_mib() - before < 60  # of which the other process's libraries are most
    work.close()
    before = held_mib()
    del array, work
    assert held_mib() < before - 95


def test_a_clip_is_made_of_its_messages_with_little_memory_beside_it(made_clip):
    """In memory that another process can share, without a copy on the way."""
    buffer, camera = ClipBuffer(), replace(made_clip.camera, width=640, height=480)
    frames = np.random.default_rng(0).integers(0, 255, (40, 480, 640, 3), dtype=np.uint8)
    clip = Clip(frames, made_clip.start_ns, made_clip.period_s, camera, np.ones(frames.shape[:3], np.float32), np.ones(frames.shape[:3], np.uint8))
    stamps = slot_stamps(clip)
    for name, fields in (*clip_messages(clip, stamps), *mask_messages(clip, stamps)):
        buffer.take(name, to_ros(TOPICS[name].type_name, fields))
    give_back()
    Path("/proc/self/clear_refs").write_text("5")  # the largest resident size begins anew
    before = of_self("VmRSS", "status")
    made = buffer.clip()
    most = of_self("VmHWM", "status")
    pairs = [(getattr(made, name), getattr(clip, name)) for name in ("frames", "depth", "labels")]
    assert all(np.array_equal(one, other) for one, other in pairs)
    assert all(place_of(one) is not None for one, _ in pairs)
    assert most - before < 1.2 * sum(one.nbytes for one, _ in pairs) / 2**20


@pytest.mark.parametrize(("stage", "work"), [(SegmentNode, "diffphys_ros.segment.label_clip"), (SplatNode, "diffphys_ros.inverse.fit_gaussians")])
def test_the_work_of_a_stage_takes_its_memory_along(make_node, made_clip, monkeypatch, stage, work):
    """It is done in another process than the node's, and a whole clip is in memory that both see."""
    monkeypatch.setattr(work, None)
    node, stamps = make_node(stage), slot_stamps(made_clip)
    for name, fields in (*clip_messages(made_clip, stamps), *mask_messages(made_clip, stamps)):
        node.buffer.take(name, to_ros(TOPICS[name].type_name, fields))
    clip, *_ = [news.clip for news in node.job()() if isinstance(news, Assembled)]
    assert (place_of(clip.frames) is not None) == (stage is SegmentNode)
