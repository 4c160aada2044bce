"""Command line: `diffphys recover | batch | ingest | capture | simulate | score | settings`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

from . import __version__, config
from .errors import InputError, SimulationError, short, shown

FAILED, USAGE_ERROR, FAULT, INTERRUPTED = 1, 2, 70, 130
SELF_TESTS = {"guess_scale": ("the first guess of Young's modulus", "a recording"), "start_scale": ("the start values of Young's modulus", "a prepared .npz")}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit status: 0 done, 1 clips of a batch failed, 2 bad input, 70 an error of the program, 130 interrupted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy and torch are imported: the tensors are small, threads cost more than they give
    options = argparse.Namespace(command="")
    try:
        options = _parse(list(sys.argv[1:] if arguments is None else arguments))
        return options.run(options) or 0
    except (InputError, SimulationError) as error:
        print(f"diffphys: {error}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        again = "the same command goes on from there" if options.command == "capture" else "`--resume` goes on from the last checkpoint"
        print(f"diffphys: interrupted; {again}", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        print(f"diffphys: {_fault(error)}", file=sys.stderr)
        return FAULT


def _fault(error: Exception) -> str:
    """One sentence about an error of the program, whose traceback goes to a file."""
    said = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        with tempfile.NamedTemporaryFile("w", prefix="diffphys-", suffix=".txt", delete=False) as file:
            file.write("".join(traceback.format_exception(error)))
    except OSError:
        return f"error of the program ({said}); please report it with the input that led to it"
    return f"error of the program ({said}); please report it with {file.name} and the input that led to it"


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = _Parser(prog="diffphys", description="Stiffness and forces of a deforming object from one video.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True)

    for name, run, text, out in (
        ("recover", _recover, "clip in, fields out", "folder of the results"),
        ("ingest", _ingest, "clip in, prepared clip.npz out (tracks, start values; the solver goes on from it elsewhere)", "clip.npz to write"),
    ):
        command = commands.add_parser(name, help=text, description=text + ". Settings are flags with dotted names: `diffphys settings` lists them.")
        command.add_argument("clip", help="MCAP file, rosbag2 folder, video file, image folder, or a prepared .npz")
        _common(command, run, out)
        if name == "recover":
            command.add_argument("--resume", action="store_true", help="go on from the checkpoint in --out")
            command.add_argument("--side_by_side", metavar="N", help="runs that share this machine: each has N times the time")
            for flag, (text, clip) in SELF_TESTS.items():
                command.add_argument(f"--{flag}", metavar="FACTOR", help=f"self-test: factor on {text} of {clip}, which the answer must forget")

    _batch_command(commands)

    text = "pictures of the still object from all around in; cameras, sparse points, Gaussians and frame 0's depth out"
    capture = commands.add_parser("capture", help=text, description=text + ". Settings are flags with dotted names: `diffphys settings` lists them.")
    capture.add_argument("images", type=Path, help="folder of images, video file, MCAP file or rosbag2 folder")
    capture.add_argument("--clip", type=Path, help="the clip whose object this is: its frame 0 gives world frame and metric scale")
    _common(capture, _capture, "folder of the capture, for depth.capture")

    text = "a result simulated again, from its recovery.npz alone: the trajectory that it holds, or with other stiffness and force"
    simulate = commands.add_parser("simulate", help=text, description=text + ".")
    simulate.add_argument("folder", type=Path, help="folder that recover wrote")
    simulate.add_argument("--out", required=True, type=Path, help=".npz to write: trajectory (T, N, 3) [m, world], period_s")
    for name, text in (("young_scale", "factor on every Young's modulus"), ("force_scale", "factor on every force")):
        simulate.add_argument(f"--{name}", default="1", help=text)
    simulate.add_argument("--device", default="cpu", help="cpu or cuda:0")
    simulate.set_defaults(run=_simulate)

    score = commands.add_parser("score", help="compare results with a known truth")
    score.add_argument("folder", type=Path, help="folder that recover wrote")
    score.add_argument("--truth", required=True, type=Path, help="truth.npz")
    score.set_defaults(run=_score)
    commands.add_parser("settings", help="list every setting with unit, range and default").set_defaults(run=_settings)

    broken = next((word for word in arguments if config.BROKEN.search(word)), None)
    if broken is not None:
        raise InputError(f"command line: {shown(broken)} holds control characters or broken Unicode; rename the file or correct the word")
    own, settings = _sorted_out(arguments)
    options, rest = parser.parse_known_args(own)
    if (rest or settings) and not hasattr(options, "config"):
        raise InputError(f"command line: {short((rest or settings)[0])} is unknown here; see `diffphys {options.command} --help`")
    options.words = settings + rest
    options.flags = config.flags_of(options.words)
    if options.flags:
        config.require_read(options.flags, f"diffphys {options.command}", "command line")
    return options


def _batch_command(commands: Any) -> None:
    text = "many clips in, a folder of results each and a summary out"
    command = commands.add_parser("batch", help=text, description=text + ". Settings are flags with dotted names: `diffphys settings` lists them.")
    command.add_argument("clips", nargs="+", help="recordings, and folders that are searched for them; given.yaml beside one is its settings, truth.npz its known answer")
    _common(command, _batch, "folder of the results: one folder a clip, summary.csv, summary.md")
    command.add_argument("--workers", help="clips at a time; as many as cores, memory and GPUs carry where not given")
    command.add_argument("--timeout_s", help="longest time for one clip [s]; twice its time budget where not given, and ten minutes at least")
    command.add_argument("--shard", metavar="I/N", help="run every N-th clip from the I-th on; several machines share --out, or merge with --resume")
    command.add_argument("--resume", action="store_true", help="keep what is done in --out, go on from checkpoints")
    command.add_argument("--address", help="run on a Ray cluster: auto, HOST:PORT, or local")


class _Once(argparse.Action):
    """A flag of one value; given twice, one of them would be lost."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option: str | None = None) -> None:
        given = namespace.__dict__.setdefault("given", set())
        if option in given:
            raise InputError(f"command line: {option} is given twice; keep one")
        if option:
            given.add(option)
        setattr(namespace, self.dest, values)


class _Parser(argparse.ArgumentParser):
    """Takes no abbreviations, which would let `--conf` pass for `--config`, and no flag twice."""

    def __init__(self, **words: Any) -> None:
        super().__init__(**words, allow_abbrev=False)
        self.register("action", None, _Once)
        self.register("action", "store", _Once)


def _sorted_out(words: list[str]) -> tuple[list[str], list[str]]:
    """The words that are the command's own, and settings with their values, wherever they stand."""
    own: list[str] = []
    settings: list[str] = []
    left = list(words)
    while left:
        word = left.pop(0)
        dotted = word.startswith("--") and "." in word.partition("=")[0]
        (settings if dotted else own).append(word)
        if dotted and "=" not in word and left and not left[0].startswith("--"):
            settings.append(left.pop(0))
    return own, settings


def _common(command: argparse.ArgumentParser, run: Callable[[argparse.Namespace], int], out: str) -> None:
    command.add_argument("--out", required=True, type=Path, help=out)
    command.add_argument("--config", action="append", default=[], type=Path, help="YAML of settings; may be repeated, later files win")
    command.set_defaults(run=run)


def _recover(options: argparse.Namespace) -> int:
    from . import result
    from .batch import positive

    is_prepared = str(options.clip).endswith(".npz")
    base = result.stored_settings(_existing(options.clip)) if is_prepared else {}
    begun = _begun(options, is_prepared=is_prepared)
    settings = config.layered(options.config, options.flags, base=base)
    if is_prepared:
        _without_prediction(settings)
    side_by_side = positive("side_by_side", options.side_by_side, int) or 1
    from .inverse import Checkpoint, clock_of, run, solve_prepared  # these take seconds: what is wrong with the words is said before
    from .predict import Figures, predicted

    clock = clock_of(settings, side_by_side=side_by_side)
    with result.owned(options.out) as out:
        checkpoint = Checkpoint(out / result.CHECKPOINT, every_s=settings.experiment.checkpoint_every_s, resume=options.resume)
        if is_prepared:
            prepared = result.load_prepared(options.clip)
            steps = solve_prepared(prepared, settings, checkpoint=checkpoint, clock=clock, **begun)
        else:
            steps = run(_existing(options.clip), settings, checkpoint=checkpoint, clock=clock, **begun)
        prepared, splats, recovery = show(steps)
        recovery = show(predicted(options.clip, prepared, splats, recovery, settings))
        notes = result.write_all(recovery, prepared.clip, settings, out, splats=splats)
        checkpoint.remove()
    for note in (*recovery.notes, *notes):
        print(f"note: {note}")
    for name in ("psnr_masked", "psnr_masked_frozen_frame"):
        print(f"{name}: {recovery.metrics[name]:.2f} dB")
    if isinstance(found := recovery.metrics.get("prediction"), dict):
        print(f"prediction: {Figures(**found).described()}")
    print(f"results in {options.out}")
    return 0


def _without_prediction(settings: config.Settings) -> None:
    """Raises InputError where a prepared clip is to be judged by frames that it has not got."""
    if settings.frames.predict:
        raise InputError(
            f"frames.predict is {settings.frames.predict}, must be 0 for a prepared .npz, which holds the frames of the fit alone; set it to 0 (frames.fit cuts), "
            "or recover the recording itself"
        )


def _begun(options: argparse.Namespace, *, is_prepared: bool) -> dict[str, Any]:
    """How far off the search is to begin, under the library's name for it; empty where nothing is said."""
    given = {name: getattr(options, name) for name in SELF_TESTS if getattr(options, name) is not None}
    for name, text in given.items():
        if (name == "start_scale") != is_prepared:
            raise InputError(f"command line: --{name} is for {SELF_TESTS[name][1]}, {short(options.clip)} is none; leave it out")
        if not 0.01 <= (value := _number(name, text)) <= 100:
            raise InputError(f"command line: --{name} is {value:g}, must be in 0.01 .. 100; 1 begins where the search begins by itself")
    return {name: float(text) for name, text in given.items()}


def _batch(options: argparse.Namespace) -> int:
    from .batch import Request, parse_shard, positive, run_batch

    request = Request(
        clips=tuple(options.clips),
        out=options.out,
        configs=tuple(options.config),
        flags=options.flags,
        words=tuple(options.words),
        workers=positive("workers", options.workers, int),
        timeout_s=positive("timeout_s", options.timeout_s, float),
        shard=parse_shard(options.shard),
        resume=options.resume,
        address=options.address,
    )
    return FAILED if run_batch(request) else 0


def _ingest(options: argparse.Namespace) -> int:
    settings = config.layered(options.config, options.flags)
    _without_prediction(settings)
    from . import result
    from .bags.read import read_clip
    from .inverse import prepare

    result.check_writable(options.out.parent)
    prepared = show(prepare(read_clip(_existing(options.clip), settings, frames=settings.frames), settings))
    result.save_prepared(options.out, prepared, settings)
    print(f"prepared clip in {options.out}")
    return 0


def _capture(options: argparse.Namespace) -> int:
    settings = config.layered(options.config, options.flags)
    from .capture import reconstruct

    clip = None if options.clip is None else _existing(options.clip)
    show(reconstruct(_existing(options.images), options.out, settings, clip))
    print(f"capture in {options.out}")
    return 0


def _simulate(options: argparse.Namespace) -> int:
    import numpy as np

    from . import result, store
    from .resimulate import simulate_again

    young_scale, force_scale = (_number(name, getattr(options, name)) for name in ("young_scale", "force_scale"))
    recovery = result.load(options.folder)
    result.check_writable(options.out.parent)
    trajectory = simulate_again(recovery, young_scale=young_scale, force_scale=force_scale, device=options.device)
    arrays = {"trajectory": trajectory, "period_s": recovery.period_s, "young_scale": young_scale, "force_scale": force_scale}
    store.write_arrays(options.out, arrays)
    away = np.linalg.norm(trajectory.astype(float) - recovery.trajectory, axis=-1)
    print(f"simulated by {recovery.simulation.engine}: {away.max():.3g} m from the recovered trajectory at most, {np.sqrt((away**2).mean()):.3g} m rms")
    print(f"trajectory in {options.out}")
    return 0


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"command line: --{name} is {short(text)}, must be a number; 1 changes nothing") from error


def _score(options: argparse.Namespace) -> int:
    from .score import score_folder

    for name, value in score_folder(options.folder, _existing(options.truth)).items():
        print(f"{name}: {value}")
    return 0


def _settings(options: argparse.Namespace) -> int:
    from .inverse.registered import registered

    last = ""
    for leaf in config.leaves().values():
        if leaf.heading != last:
            last = leaf.heading
            print(f"\n# {last}")
        print(f"{leaf.name:32} {leaf.default!s:10} {leaf.unit:8} {leaf.range_text or registered(leaf.name):24} {leaf.doc}")
    return 0


def _existing(path: str | Path) -> Path:
    from .bags.storage import existing

    return existing(path)


def _between_bars_s() -> float:
    """A terminal shows one bar in place of the last; a file keeps them all."""
    return 0.1 if sys.stderr.isatty() else 10.0


def show(steps: Generator[Any, None, Any]) -> Any:
    """Drives a generator of Progress, printing stages as lines and iterations as a bar with loss and time left."""
    from tqdm import tqdm

    bar: tqdm | None = None
    try:
        while True:
            news = next(steps)
            if news.iterations and news.iteration:
                if bar is None or bar.desc != news.stage or bar.total != news.iterations:
                    if bar is not None:
                        bar.close()
                    bar = tqdm(total=news.iterations, desc=news.stage, bar_format="{desc:8} {n_fmt}/{total_fmt} |{bar}| {postfix} {elapsed}", miniters=1, mininterval=_between_bars_s())
                loss = "" if news.loss is None else f"loss {news.loss:.4g}"
                left = "" if news.seconds_left is None else f", {news.seconds_left:.0f} s left"
                bar.set_postfix_str(loss + left + (f" {news.text}" if news.text else ""), refresh=False)
                bar.update(news.iteration - bar.n)
            elif news.text:
                (tqdm.write if bar is not None else print)(f"{news.stage:8} {news.text}")
                sys.stdout.flush()
    except StopIteration as stop:
        return stop.value
    finally:
        if bar is not None:
            bar.close()


if __name__ == "__main__":
    sys.exit(main())
