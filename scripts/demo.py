#!/usr/bin/env python3
"""Plays the bundled sample through fit_node as a user would run it, beside a subscriber that prints what a robot would
receive; then compares with the known truth. Exit status 0 only if every process ended well and every bound below is met."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from processes import PROGRAMS, last_lines, module, node, run, shown, start, stop

from diffphys_ros import config, result
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.colours import pascals
from diffphys_ros.report import figure
from diffphys_ros.score import net_force, read_truth

OUT = Path("out/demo")
BUDGET_S = 150.0  # of the fit
LIMIT_S = 900.0  # of the fit with all around it, on however busy a machine; then something hangs
FILES_S = 60.0  # for the last file after the last message

YOUNG, RATIO, COSINE, FALSE_FORCE, GAIN_DB = 0.15, 0.12, 0.95, 0.05, 8.0  # bounds, shares and dB
MOTION = 0.036  # of the rms motion; the linear motion of the start values misses .045


def main() -> int:
    """The whole demonstration; returns the exit status."""
    began, sample = time.monotonic(), sample_folder()
    shutil.rmtree(OUT, ignore_errors=True)
    result.check_writable(OUT)
    if not play(sample, began):
        return 1
    score = [str(PROGRAMS / "diffphys"), "score", str(OUT), "--truth", str(sample / "truth.npz")]
    print(f"\n$ {shown(score)}", flush=True)
    if subprocess.run(score, stdout=subprocess.DEVNULL).returncode:
        return 1
    metrics = result.read_metrics(OUT)
    overlay_truth(sample, metrics)
    good = print_comparison(metrics)
    print_places()
    print(f"\n{time.monotonic() - began:.0f} s in all")
    return 0 if good else 1


def play(sample: Path, began: float) -> bool:
    """fit_node on the sample and a subscriber beside it, as two processes; whether both ended well."""
    given = {"bag": sample / "clip.mcap", "config": sample / "given.yaml", "out": OUT, "fit.time_budget_s": BUDGET_S}
    fit, listen = node("fit_node", given), module("diffphys_ros.nodes.listen", "--node", "fit_node")
    log = OUT.with_suffix(".log")
    print(f"$ {shown(fit)}\n$ {shown(listen)}\n", flush=True)
    with log.open("w") as output:
        running = {"fit_node": start(fit, output), "the subscriber": start(listen)}
        try:
            fault = watch(*running.values(), began)
        finally:
            ended = {name: stop(process) for name, process in reversed(running.items())}
    faults = [text for text in (fault, *(f"{name} ended with status {status}" for name, status in ended.items() if status)) if text]
    for text in faults:
        print(f"demo: {text}", file=sys.stderr)
    if faults:
        print(f"demo: {last_lines(log)}", file=sys.stderr)
    return not faults


def watch(fit: subprocess.Popen, robot: subprocess.Popen, began: float) -> str:
    """Waits for the subscriber to have everything and for the last file; what went wrong, or nothing."""
    while robot.poll() is None:
        if fit.poll() is not None:
            return "fit_node ended before the subscriber had its answer"
        if time.monotonic() - began > LIMIT_S:
            return f"not done after {LIMIT_S:.0f} s"
        time.sleep(0.1)
    until = time.monotonic() + FILES_S
    while not (OUT / result.FIGURE).exists() and fit.poll() is None and time.monotonic() < until:
        time.sleep(0.1)
    missing = [name for name in (result.RECOVERY, result.RECORDING, result.RERUN, result.FIGURE) if not (OUT / name).exists()]
    return f"{', '.join(missing)} not written" if missing else ""


def overlay_truth(sample: Path, metrics: dict[str, Any]) -> None:
    """Draws the summary again with the truth over it."""
    settings = config.layered([sample / "given.yaml"])
    truth = figure.Truth(metrics["young_true_pa"], net_force(read_truth(sample / "truth.npz")))
    figure.summary(OUT / "summary_vs_truth.png", result.load(OUT), read_clip(sample / "clip.mcap", settings), truth=truth)


def print_comparison(metrics: dict[str, Any]) -> bool:
    """Recovered against true, line by line; whether every bound is met."""
    rows = list(comparison(metrics))
    width = max(len(name) for name, *_ in rows)
    print(f"\n{'':{width}}  {'recovered':>12}  {'true':>10}  {'':>9}")
    for name, found, true, error, good in rows:
        print(f"{name:{width}}  {found:>12}  {true:>10}  {error:>9}  {'' if good is None else 'ok' if good else 'short'}")
    return all(good is not False for *_, good in rows)


def comparison(metrics: dict[str, Any]) -> list[tuple[str, str, str, str, bool | None]]:
    """Rows of name, recovered, true, error or bound, and whether the bound is met (None: it has none)."""
    rows: list[tuple[str, str, str, str, bool | None]] = []
    for part, (found, true) in enumerate(zip(metrics["young_pa"], metrics["young_true_pa"], strict=True), 1):
        error = None if found is None else found / true - 1
        words = "unknown" if error is None else f"{100 * error:+.1f} %"
        rows.append(
            (
                f"Young's modulus, part {part}",
                pascals(found or float("nan")),
                pascals(true),
                words,
                error is not None and abs(error) <= YOUNG,
            )
        )
    ratio = metrics["young_ratio_error"]
    if ratio is not None:
        rows.append(
            ("error of the stiff/soft ratio", f"{100 * (10**ratio - 1):.1f} %", "", f"<= {100 * RATIO:.0f} %", 10**ratio - 1 <= RATIO)
        )
    cosine, false_force, motion = (metrics[name] for name in ("net_force_cosine", "false_force_ratio", "trajectory_rmse_over_rms_motion"))
    simulated = metrics["misfit_refined"]
    nearer = "none" if simulated is None else f"{100 * simulated / metrics['misfit_start']:.0f} %"
    rows += [
        ("misfit of the simulation, share of the start's", nearer, "0", "refined", bool(metrics["refined"])),
        ("peak net force", f"{metrics['force_peak_n']:.3g} N", f"{metrics['force_peak_true_n']:.3g} N", "", None),
        ("direction of the net force, cosine", f"{cosine:.3f}", "1", f">= {COSINE}", cosine >= COSINE),
        ("false force, share of the peak", f"{100 * false_force:.1f} %", "0", f"<= {100 * FALSE_FORCE:.0f} %", false_force <= FALSE_FORCE),
        ("misfit of the motion, share of its rms", f"{100 * motion:.1f} %", "0", f"<= {100 * MOTION:.1f} %", motion <= MOTION),
    ]
    psnr, frozen = metrics["psnr_masked"], metrics["psnr_masked_frozen_frame"]
    rows.append(
        ("masked PSNR over the frozen first frame", f"{psnr - frozen:+.1f} dB", "", f">= {GAIN_DB:.0f} dB", psnr - frozen >= GAIN_DB)
    )
    return rows


def print_places() -> None:
    """Where to look."""
    rerun = PROGRAMS / "rerun"
    print("\nLook at")
    for place, words in (
        (OUT / "summary_vs_truth.png", "input, render, material, force against truth"),
        (f"{shown([str(rerun), str(OUT / result.RERUN)])}", "the same in 3D over time"),
        (OUT / result.RECORDING, "the published topics, for `ros2 bag play`"),
        (OUT / result.RECOVERY, "the fields as arrays"),
        (OUT / result.METRICS, "every figure"),
    ):
        print(f"  {place!s:44}  {words}")


if __name__ == "__main__":
    run(main)
