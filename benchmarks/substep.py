"""Time of one simulator substep, forward and backward, replays included: python benchmarks/substep.py [cpu] [cuda]

One whole differentiated frame of a cantilever over its substeps; the median of several. Rows:

    substep_*               frames whose states fit `memory_budget_mb` (512 where a row says nothing else) are kept
    substep_*_replayed      nothing is kept between the passes (memory_budget_mb = 0)
    substep_*_forward       without gradients
    substep_*_rollout       frames in a row and then their gradient: what a fit sees
    prototype_*             prototype.py, run beside ours; ..._gain: its time over ours
    *_gain_published        a published figure of the same case over ours (PUBLISHED)
    floor_*                 what the device allows: four smallest kernels in a graph, or the bytes of the states and nodes that
                            a substep must move over the bandwidth of a copy; *_over_floor: ours over the larger of the two
    recover_step_peak_gb    most memory of torch and Warp together in a 60-frame rollout and its gradient
"""

from __future__ import annotations

import gc
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
import warp as wp
from cases import CASES, GRAVITY, MASS_DAMPING, PERIOD_S, POISSON, YOUNG, Case
from prototype import Prototype
from table import Row, record, row

from diffphys_ros.simulate import Simulator

REPEATS, FRAMES, ROLLOUT, BATCH, BATCH_CPU = 9, 60, 20, 128, 8
LARGE_BUDGET_MB = 4096.0  # what a GPU has to spare for a batch or a large body
SCALE = {"ms": 1e3, "us": 1e6}
# Forward + backward of one substep, of the solver named, at the same particles and nodes; one H200, one processor core.
PUBLISHED = {
    "substep_single_1335_64": {"plain Warp with CUDA graph": 116.0, "PhysDreamer": 1733.0},
    "substep_20k_64": {"plain Warp with CUDA graph": 225.0},
    "substep_100k_64": {"plain Warp with CUDA graph": 1149.0},
    "substep_cpu_1335_32": {"plain Warp": 4.6},
}
PARTICLE_BYTES = 608  # state read and written, state, adjoint and constants read, adjoint written
NODE_BYTES = 192  # of a node in the box: momentum, velocity and their adjoints, written, read and emptied


def clock(device: str) -> float:
    """Time at which everything launched so far has ended [s]."""
    if device.startswith("cuda"):
        torch.cuda.synchronize(device)
    return time.perf_counter()


def median(run: Callable[[], object], device: str, repeats: int = REPEATS) -> float:
    """Of the time of a run [s], the first two left out."""
    times = []
    for _ in range(repeats + 2):
        start = clock(device)
        run()
        times.append(clock(device) - start)
    return statistics.median(times[2:])


def seconds(sim: Simulator, device: str, *, gradient: bool = True, frames: int = 1) -> float:
    """Time of a frame, over its substeps and simulations [s]."""
    young = torch.full_like(sim.volume, YOUNG, requires_grad=gradient)
    force = torch.zeros(frames, *sim.x_rest.shape, device=device, requires_grad=gradient)
    start, poisson = sim.rest(), sim.tensor(POISSON)

    def run() -> None:
        if frames == 1:
            state = sim.frame(start, young, poisson, force[0], MASS_DAMPING)
        else:
            state = sim.rollout(start, young, poisson, force, MASS_DAMPING)
        if gradient:
            state.x[..., 1].sum().backward()

    return median(run, device) / sim.substeps / sim.batch / frames


def timed(name: str, unit: str, case: str, device: str, *, batch: int | None = None, budget: float = 512.0) -> list[Row]:
    """Rows of a case: kept, replayed, without gradients and as frames of a rollout that are all kept."""
    rows = []
    for suffix, mb, gradient in (("", budget, True), ("_replayed", 0.0, True), ("_forward", 0.0, False)):
        sim = CASES[case].simulator(device, batch=batch, memory_budget_mb=mb)
        rows.append(row(name + suffix, SCALE[unit] * seconds(sim, device, gradient=gradient), unit, device=device))
        del sim
    if batch is None and device.startswith("cuda"):  # where the time between frames counts
        sim = CASES[case].simulator(device, memory_budget_mb=budget)
        frames = max(1, min(ROLLOUT, sim.replay.plan.kept))
        rows.append(row(f"{name}_rollout", SCALE[unit] * seconds(sim, device, frames=frames), unit, device=device))
    gains = [
        row(f"{name}_gain_published_{who.split()[0].lower()}", value / rows[0].value, "x", device=device)
        for who, value in PUBLISHED.get(name, {}).items()
    ]
    return rows + gains


def prototype(case: Case, device: str) -> tuple[Callable[[], None], Prototype]:
    """A run of one frame and its gradient by the prototype: a CUDA graph where there is one."""
    peer = Prototype(
        case.body,
        case.grid,
        young=YOUNG,
        poisson=POISSON,
        dt=PERIOD_S / case.substeps,
        substeps=case.substeps,
        mass_damping=MASS_DAMPING,
        gravity=GRAVITY,
        device=device,
    )
    peer.weight.assign(np.tile([0.0, 1.0, 0.0], (case.particles, 1)))

    def run() -> None:
        peer.forward()
        peer.backward()

    run()
    if not device.startswith("cuda"):
        return run, peer
    with wp.ScopedCapture(device=device) as capture:
        run()
    return lambda: (wp.capture_launch(capture.graph), wp.synchronize_device(device)), peer  # type: ignore[return-value]


def beside(name: str, unit: str, case: str, device: str, ours: Row) -> list[Row]:
    """The prototype on the same case, after a check that its gradient is ours."""
    run, peer = prototype(CASES[case], device)
    value = SCALE[unit] * median(run, device, 3) / CASES[case].substeps
    sim = CASES[case].simulator(device)
    young = torch.full_like(sim.volume, YOUNG, requires_grad=True)
    sim.frame(sim.rest(), young, sim.tensor(POISSON), None, MASS_DAMPING).x[:, 1].sum().backward()
    theirs = peer.gradient()
    off = float(np.abs(young.grad.cpu().numpy() - theirs).max() / np.abs(theirs).max())  # type: ignore[union-attr]
    return [
        row(f"prototype_{name}", value, unit, device=device),
        row(f"prototype_{name}_gain", value / ours.value, "x", device=device),
        row(f"prototype_{name}_gradient_difference", off, "1", device=device),
    ]


def floor(name: str, case: str, device: str, ours: Row, launch_us: float, bytes_per_s: float, batch: int = 1) -> list[Row]:
    """What launches and memory leave room for, a simulation."""
    sim = CASES[case].simulator(device)
    moved = CASES[case].particles * PARTICLE_BYTES + sim.replay.room * NODE_BYTES
    traffic, launches = 1e6 * moved / bytes_per_s, 4 * launch_us / batch
    return [
        row(f"floor_traffic_{name}", traffic, "us", device=device),
        row(f"floor_launches_{name}", launches, "us", device=device),
        row(f"substep_{name}_over_floor", ours.value / max(traffic, launches), "x", device=device),
    ]


def smallest_launch_us(device: str, launches: int = 1000) -> float:
    """Time of a kernel that does nothing, in a graph [us]."""

    @wp.kernel(enable_backward=False)
    def nothing(a: wp.array(dtype=int)):  # type: ignore[valid-type]
        pass

    array = wp.zeros(1, dtype=int, device=device)
    wp.launch(nothing, 1, [array], device=device)
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(launches):
            wp.launch(nothing, 1, [array], device=device)
    return 1e6 * median(lambda: (wp.capture_launch(capture.graph), wp.synchronize_device(device)), device) / launches


def bandwidth(device: str, size: int = 2**28) -> float:
    """Bytes a second that a copy of 1 GiB reads and writes."""
    source, target = (torch.empty(size, device=device) for _ in range(2))
    return 8 * size / median(lambda: target.copy_(source), device)


def peak_gb(device: str) -> float:
    """Most memory that a rollout of 60 frames and its gradient take [GB]."""
    gc.collect()  # simulators and their graphs hold each other
    torch.cuda.empty_cache()
    torch.cuda.reset_peak_memory_stats(device)
    sim = CASES["5k_64"].simulator(device)
    young = torch.full_like(sim.volume, YOUNG, requires_grad=True)
    force = torch.zeros(FRAMES - 1, *sim.x_rest.shape, device=device, requires_grad=True)
    path = sim.rollout(sim.rest(), young, sim.tensor(POISSON), force, MASS_DAMPING)
    path.x[:, -1, 1].square().sum().backward()
    return (torch.cuda.max_memory_allocated(device) + wp.get_mempool_used_mem_high(device)) / 1e9


def on_cpu() -> list[Row]:
    """Rows of this processor: one core, then all."""
    rows = timed("substep_cpu_1335_32", "ms", "1335_32", "cpu")
    rows += beside("cpu_1335_32", "ms", "1335_32", "cpu", rows[0])
    rows = [replace(r, device=f"{r.device} (one core)") for r in rows]
    return rows + timed(f"substep_cpu_batch{BATCH_CPU}_1335_32", "ms", "1335_32", "cpu", batch=BATCH_CPU, budget=LARGE_BUDGET_MB)


def on_cuda(device: str = "cuda:0") -> list[Row]:
    """Rows of a GPU."""
    launch_us, bytes_per_s = smallest_launch_us(device), bandwidth(device)
    rows = [row("floor_launch", launch_us, "us", device=device), row("floor_bandwidth", bytes_per_s / 1e12, "TB/s", device=device)]
    single = timed("substep_single_1335_64", "us", "1335_64", device)
    rows += single + floor("single_1335_64", "1335_64", device, single[0], launch_us, bytes_per_s)
    batch = timed(f"substep_batch{BATCH}_1335_64", "us", "1335_64", device, batch=BATCH, budget=LARGE_BUDGET_MB)
    rows += batch + floor(f"batch{BATCH}_1335_64", "1335_64", device, batch[0], launch_us, bytes_per_s, BATCH)
    for case, budget in (("20k_64", 512.0), ("100k_64", LARGE_BUDGET_MB), ("100k_128", LARGE_BUDGET_MB)):
        own = timed(f"substep_{case}", "us", case, device, budget=budget)
        rows += own + floor(case, case, device, own[0], launch_us, bytes_per_s)
        rows += beside(case, "us", case, device, own[0]) if case == "20k_64" else []
    rows += beside("single_1335_64", "us", "1335_64", device, single[0])
    return [*rows, row("recover_step_peak_gb", peak_gb(device), "GB", device=device)]


def main() -> None:
    """Measure the devices named, or what this machine has."""
    torch.set_num_threads(1)
    wanted = sys.argv[1:] or ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    record((on_cpu() if "cpu" in wanted else []) + (on_cuda() if "cuda" in wanted else []))


if __name__ == "__main__":
    main()
