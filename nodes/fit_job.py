"""The fit as it runs in a process of its own: it needs no ROS."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffphys_ros import config
from diffphys_ros.msg_schemas import fields
from diffphys_ros.progress import Progress
from diffphys_ros.types import Clip, Splats

if TYPE_CHECKING:
    from diffphys_ros.inverse import Checkpoint

OUT_FLAG = " with --out"  # of the command line, in sentences about result folders


def recover(source: Clip | Path, splats: Splats | None, settings: config.Settings, out: str, resume: bool, run: str, node: str) -> Generator[Any, None, list[str]]:
    """News, then the fields.Answer, then the files in `out`, where that is given; returns what was left out, one sentence each.

    `run` names this fit in the metrics, `node` the node whose topics are recorded. Owns `out` as long as it runs.
    """
    if not out:
        clip = yield from _read(source, settings)
        from diffphys_ros.inverse import Checkpoint

        yield (yield from _answered(clip, splats, settings, Checkpoint(None), run, node))[0]
        return []
    from diffphys_ros import result

    with result.owned(out) as folder:
        clip = yield from _read(source, settings)
        from diffphys_ros.inverse import Checkpoint

        path = folder / result.CHECKPOINT
        checkpoint = Checkpoint(path, every_s=settings.experiment.checkpoint_every_s, resume=resume and path.exists())
        answer, clip, fitted = yield from _answered(clip, splats, settings, checkpoint, run, node)
        yield answer
        left_out = result.write_all(answer.recovery, clip, settings, folder, splats=fitted, node=node)
        checkpoint.remove()
        return left_out


def _read(source: Clip | Path, settings: config.Settings) -> Generator[Progress, None, Clip]:
    """The clip, read where it is a recording: before anything imports torch, which takes seconds, so that a bad one is soon known."""
    if isinstance(source, Clip):
        return source
    from diffphys_ros.bags.read import read_clip

    yield Progress("reading", text=str(source))
    return read_clip(source, settings, frames=settings.frames)


def _answered(
    clip: Clip, splats: Splats | None, settings: config.Settings, checkpoint: Checkpoint, run: str, node: str
) -> Generator[Any, None, tuple[fields.Answer, Clip, Splats]]:
    from diffphys_ros import inverse

    prepared, fitted, recovery = yield from inverse.run(clip, settings, splats=splats, checkpoint=checkpoint)
    recovery = replace(recovery, metrics=recovery.metrics | {"run": run})
    return fields.answer(recovery, prepared.clip, settings, node=node), prepared.clip, fitted
