"""The fit as it runs in a process of its own: it needs no ROS."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffphys_ros import config
from diffphys_ros.msg_schemas import fields
from diffphys_ros.types import Clip, Splats

if TYPE_CHECKING:
    from diffphys_ros.inverse import Checkpoint

OUT_FLAG = " with --out"  # of the command line, in sentences about result folders


def recover(source: Clip | Path, splats: Splats | None, settings: config.Settings, out: str, resume: bool, run: str, node: str) -> Generator[Any, None, list[str]]:
    """News, then the fields.Answer, then the files in `out`, where that is given; returns what was left out, one sentence each.

    `run` names this fit in the metrics, `node` the node whose topics are recorded. Owns `out` as long as it runs.
    """
    from diffphys_ros.inverse import Checkpoint

    if not out:
        yield (yield from _answered(source, splats, settings, Checkpoint(None), run, node))[0]
        return []
    from diffphys_ros import result

    with result.owned(out) as folder:
        path = folder / result.CHECKPOINT
        checkpoint = Checkpoint(path, every_s=settings.fit.checkpoint_every_s, resume=resume and path.exists())
        answer, clip, fitted = yield from _answered(source, splats, settings, checkpoint, run, node)
        yield answer
        left_out = result.write_all(answer.recovery, clip, settings, folder, splats=fitted, node=node)
        checkpoint.remove()
        return left_out


def _answered(
    source: Clip | Path, splats: Splats | None, settings: config.Settings, checkpoint: Checkpoint, run: str, node: str
) -> Generator[Any, None, tuple[fields.Answer, Clip, Splats]]:
    from diffphys_ros import inverse

    prepared, fitted, recovery = yield from inverse.run(source, settings, splats=splats, checkpoint=checkpoint)
    recovery = replace(recovery, metrics=recovery.metrics | {"run": run})
    return fields.answer(recovery, prepared.clip, settings, node=node), prepared.clip, fitted
