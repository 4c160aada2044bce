"""Recovers clips as the paper's tables ask, then writes the tables and figures. The same command goes on where it was stopped.

    python -m tools.paper --out out/paper [--quick] [--device cuda:0] [--only paper default] [--lpips FOLDER]

Clips: the bundled ones, and those of the folder that DIFFPHYS_REAL names. A quick run takes one bundled clip and few frames."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from diffphys_ros import config, result
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.batch import Request, run_batch
from diffphys_ros.batch.find import Recording, find_recordings
from diffphys_ros.devices import usable
from diffphys_ros.errors import InputError
from diffphys_ros.metrics.lpips import Lpips

from . import page, rows
from .figures import draw_all, drawn
from .variants import CONFIG, VARIANTS, Variant

FIGURES = "figures"  # of all runs, a folder each


def main(words: Sequence[str] | None = None) -> int:
    """Runs what is not done and writes the page; returns the exit status: 1 where a run failed, 130 where it was interrupted."""
    options = _options(words)
    chosen = _chosen(options)
    failed, stopped = 0, False
    try:
        options.device = usable(options.device, setting="--device")
        for variant in chosen:
            failed += _recovered(variant, options)
    except KeyboardInterrupt:
        stopped = True
    except InputError as error:
        print(f"paper: {error}", file=sys.stderr)
        return 2
    written = _written(chosen, options)
    print(f"{written}{'; interrupted, the same command goes on' if stopped else ''}")
    return 130 if stopped else int(failed > 0)


def _options(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/paper"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--device", default="auto", help="fit.device")
    parser.add_argument("--only", nargs="*", choices=[variant.name for variant in VARIANTS], help="these rows alone")
    parser.add_argument("--lpips", type=Path, help="folder of the weights, experiment.lpips_weights")
    return parser.parse_args(words)


def _chosen(options: argparse.Namespace) -> list[Variant]:
    """The rows that are named, else all that such a run has."""
    if options.only:
        return [variant for variant in VARIANTS if variant.name in options.only]
    return [variant for variant in VARIANTS if variant.quick or not options.quick]


def clips(*, quick: bool) -> tuple[str, ...]:
    """What is recovered: paths of recordings."""
    bundled = sample_folder()
    real = os.environ.get("DIFFPHYS_REAL", "")
    if quick:
        return (str(bundled / "clip.mcap"),)
    return str(bundled / "clip.mcap"), str(bundled.parent / "sample_strip" / "clip.mcap"), *([real] if real else [])


def folder_of(variant: Variant, options: argparse.Namespace) -> Path:
    """The batch's folder. Devices and lengths of run lie apart, so that neither takes the other's place."""
    run = options.device.replace(":", "_") + ("_quick" if options.quick else "")
    return Path(options.out) / run / variant.name


def _recovered(variant: Variant, options: argparse.Namespace) -> int:
    settings = variant.settings(device=options.device, quick=options.quick)
    words = tuple(f"--{name}={value}" for name, value in settings.items())
    print(f"== {variant.name}", flush=True)
    return run_batch(
        Request(
            clips=clips(quick=options.quick),
            out=folder_of(variant, options),
            configs=_configs(variant),
            flags=config.flags_of(words),
            words=words,
            workers=1,  # times and memory are those of a run that is alone
            resume=True,
        )
    )


def _configs(variant: Variant) -> tuple[Path, ...]:
    return (CONFIG.resolve(),) if variant.published else ()


def _written(chosen: Sequence[Variant], options: argparse.Namespace) -> Path:
    """Rows merged, figures drawn, the page; returns its path."""
    measure = Lpips.of(options.lpips) if options.lpips else None
    stored, found = rows.read(options.out / "rows.json"), []
    for recording in find_recordings(clips(quick=options.quick), out=options.out):
        settings = config.layered([recording.given] if recording.given else [])
        clip = read_clip(recording.path, settings)
        run = rows.Run(recording.name.rsplit("-", 1)[0], options.device, quick=options.quick)
        found += rows.without_physics(clip.frames, run, lpips=measure)
        if not any(row.key == (run.clip, rows.ORACLE, run.device, run.quick) for row in stored):
            found.append(rows.of_oracle(clip, _published(recording, options), run, lpips=measure))
        for variant in chosen:
            folder = folder_of(variant, options) / recording.name
            row = rows.of_recovery(folder, clip.frames, run, variant=variant.name, truth=recording.truth, lpips=measure, scored=variant.scored)
            found.append(row)
            if variant.table == 1 and not row.why:
                recovery = result.load(folder)
                draw_all(options.out / FIGURES / ", ".join([run.clip, variant.name, folder.parent.parent.name.replace("_", " ")]), recovery, clip.part(0, len(recovery.trajectory)))
    return page.write(options.out / "paper.html", rows.merged(options.out / "rows.json", found), drawn(options.out / FIGURES))


def _published(recording: Recording, options: argparse.Namespace) -> config.Settings:
    """What the row `paper` recovers a recording with."""
    words = VARIANTS[0].settings(device=options.device, quick=options.quick)
    return config.layered([CONFIG, *([recording.given] if recording.given else [])], config.flags_of([f"--{name}={value}" for name, value in words.items()]))


if __name__ == "__main__":
    sys.exit(main())
