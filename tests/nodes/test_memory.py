"""Claims about the memory that a node says it holds."""

from __future__ import annotations

import subprocess
import sys

from diffphys_ros.nodes.memory import give_back, resident_mib

HELD = "import sys; held = bytearray(b'x') * (100 << 20); print('ready', flush=True); sys.stdin.read()"


def test_what_is_held_now_counts_and_what_a_child_holds_too():
    give_back()  # what other tests left
    before = resident_mib()
    held = bytearray(b"x") * (100 << 20)
    assert 90 < resident_mib() - before < 130
    del held
    give_back()
    assert resident_mib() - before < 30
    with subprocess.Popen([sys.executable, "-c", HELD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert 90 < resident_mib() - before < 160
        child.communicate("")
    assert resident_mib() - before < 30


def test_small_pieces_go_back_to_the_system():
    """Those that the C library's allocator would keep: a hole of them below one that is still held."""
    before = resident_mib()
    pieces = [bytes(60_000) for _ in range(2000)]
    last = bytes(60_000)
    assert resident_mib() - before > 80
    del pieces
    give_back()
    assert resident_mib() - before < 30
    assert last
