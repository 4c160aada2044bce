"""How tests are shared out among pytest-xdist's workers: what builds on the same whole recovery stays together, the longest goes first."""

from __future__ import annotations

from typing import Any

from xdist.scheduler import LoadFileScheduling

CAPTURE, GATES, CLIPS = "tests/capture/", "tests/gates/", ("bar", "strip", "flat")
GRAPH = "tests/nodes/test_graph.py"
OF_FIT_NODE = (GRAPH, "tests/nodes/test_fit_node.py")  # they compare with the same fit
OF_CLIP = {"test_strip": "strip", "test_evidence": "strip", "test_damping": "flat", "test_in_motion": "flat"}  # by file; the others look at the bar
OF_FAULTS = tuple(f"tests/{name}.py" for name in ("nodes/test_clip_after_clip", "nodes/test_film", "batch/test_job", "batch/test_command", "fuzz/test_slice"))
LONGEST = (*OF_FAULTS[:2], f"{GATES}strip", f"{GATES}bar", *OF_FAULTS[2:], GRAPH, f"{GATES}flat", CAPTURE, "tests/inverse/test_outlined.py", "tests/inverse/test_fields.py")


def group_of(node: str) -> str:
    """Tests of one group go to one worker: those of a file, those that look at the one capture or at the one
    fit of fit_node, and the gates of a clip, whose recoveries last for the session."""
    file = node.split("::", 1)[0]
    if file.startswith(CAPTURE):
        return CAPTURE
    if file in OF_FIT_NODE:
        return GRAPH
    if not file.startswith(GATES):
        return file
    named = next((clip for clip in CLIPS if node.endswith(f"[{clip}]")), None)
    return GATES + (named or OF_CLIP.get(file.removeprefix(GATES).removesuffix(".py"), "bar"))


def rank(node: str, slow: bool) -> int:
    """Place in the queue; equal ones keep their order."""
    group = group_of(node)
    return LONGEST.index(group) if group in LONGEST else len(LONGEST) + (not slow)


class ByGroup(LoadFileScheduling):
    """`--dist loadfile` with the groups above."""

    def __init__(self, config: Any, log: Any) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False  # would begin with the files of most tests, which are the quickest

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid)
