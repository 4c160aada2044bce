"""Whole recoveries of the bundled clips, each made once for all gates that look at it, without the files that people look at: through the
library, which gives what the command line gives (tests/test_main.py).

A gate compares recovered quantities (stiffness, force, trajectory, spread) with the truth of another simulator. Nothing here
knows how the answer is found, so that the gates survive when that is written anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diffphys_ros import config, inverse, result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.bags.write import write_recording
from diffphys_ros.msg_schemas import recording
from diffphys_ros.progress import finished
from diffphys_ros.score import net_force, read_truth
from diffphys_ros.types import Clip, Recovery

from .clips import in_fading_light

COARSE = ("--experiment.cells", "3", "--experiment.per_cell", "1.5", "--experiment.refine_frames", "0")
ROUGH = ("--experiment.splat_iterations", "10", "--experiment.max_splats", "400")  # pictures that tell the motion; no gate asks how sharp they are
SHORT = ("--experiment.cells", "2", "--experiment.per_cell", "2", "--experiment.refine_frames", "0", "--fit.iterations", "8", *ROUGH)
BAR = (*COARSE, "--experiment.splat_iterations", "60")  # with all its Gaussians: fewer hide in its force what a damping that nothing holds does
QUICK = {"bar": BAR, "strip": SHORT, "fading": SHORT, "flat": SHORT}


@dataclass(frozen=True)
class Answer:
    """A result folder, read and scored against the truth beside its clip."""

    folder: Path
    recovery: Recovery
    metrics: dict[str, Any]  # with the figures of `diffphys score`
    true_net_force: np.ndarray  # [N], (T, 3)

    @property
    def log10_young_error(self) -> list[float]:
        """Of recovered over true, by part; NaN where not identified."""
        return [np.nan if error is None else error for error in self.metrics["young_log10_error"]]

    @property
    def trajectory_error(self) -> float:
        """Rms error over rms motion."""
        return self.metrics["trajectory_rmse_over_rms_motion"]


Recover = Callable[..., Answer]


def folder_of(kind: str) -> Path:
    """folder_of("strip") -> folder with clip.mcap, given.yaml and truth.npz: a bundled clip, or one of the tests' own."""
    if kind == "flat":
        return Path(__file__).parent / "flat"
    return sample_folder("strip" if kind == "fading" else kind)


@pytest.fixture(scope="session")
def ingested(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """ingested("strip") -> its clip.npz, from which the solver goes on. "fading" is the strip's with light that goes."""
    prepared: dict[str, Path] = {}

    def ingest(kind: str) -> Path:
        if kind in prepared:
            return prepared[kind]
        folder, prepared[kind] = folder_of(kind), tmp_path_factory.mktemp(kind) / "clip.npz"
        if kind != "fading":
            assert main(["ingest", str(folder / "clip.mcap"), "--config", str(folder / "given.yaml"), "--out", str(prepared[kind])]) == 0
            return prepared[kind]
        sound, settings = result.load_prepared(ingest("strip")), config.layered((), {}, base=result.stored_settings(ingest("strip")))
        return result.save_prepared(prepared[kind], replace(sound, clip=in_fading_light(sound.clip, folder / "truth.npz")), settings)

    return ingest


@pytest.fixture(scope="session")
def recovered(tmp_path_factory: pytest.TempPathFactory, ingested: Callable[[str], Path]) -> Recover:
    """recovered("strip", "--experiment.image_weight", "0") -> Answer; equal words are recovered once."""
    answers: dict[tuple[str, ...], Answer] = {}

    def recover(kind: str, *flags: str) -> Answer:
        key = (kind, *flags)
        if key not in answers:
            out = tmp_path_factory.mktemp("_".join(key).replace("-", "").replace("/", "")[:60])
            words = QUICK[kind]
            quick = [word for pair in zip(words[::2], words[1::2], strict=True) if pair[0] not in flags for word in pair]
            recovery, clip, settings = solved(ingested(kind), out, *quick, *flags)
            if not flags:
                write_recording(out / result.RECORDING, recording(recovery, clip, settings))
            answers[key] = scored(out, folder_of(kind) / "truth.npz")
        return answers[key]

    return recover


def solved(clip: Path, out: Path, *words: str) -> tuple[Recovery, Clip, config.Settings]:
    """What is recovered from a clip.npz, in `out` as well; of which clip, and by which settings."""
    known = config.leaves()
    flags = {name[2:]: config.parse_text(known[name[2:]], text) for name, text in zip(words[::2], words[1::2], strict=True)}
    settings, prepared = config.layered((), flags, base=result.stored_settings(clip)), result.load_prepared(clip)
    _, _, recovery = finished(inverse.solve_prepared(prepared, settings))
    result.save(recovery, prepared.clip, settings, out)
    return recovery, prepared.clip, settings


def scored(folder: Path, truth: Path) -> Answer:
    """What a result folder holds, against a truth."""
    assert main(["score", str(folder), "--truth", str(truth)]) == 0
    return Answer(folder, result.load(folder), result.read_metrics(folder), net_force(read_truth(truth)))
