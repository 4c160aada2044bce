"""The hand-written adjoints against Warp's own, recorded on a full tape over plain kernels that share nothing with ours."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp

from benchmarks.prototype import Prototype

from .bodies import block, simulator

SUBSTEPS, DT, YOUNG, POISSON, GRAVITY = 12, 4e-4, 1e5, 0.3, (0.3, -9.81, 0.5)


def prototype(body) -> Prototype:
    return Prototype(
        *body,
        young=YOUNG,
        poisson=POISSON,
        dt=DT,
        substeps=SUBSTEPS,
        mass_damping=0.7,
        gravity=GRAVITY,
        device="cpu",
        real=wp.float64,
    )


def ours(body, v: np.ndarray, F: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, ...]:
    """Last positions, and the gradients with respect to Young's moduli, start positions, velocities and deformation."""
    sim = simulator(body, substeps=SUBSTEPS, period_s=SUBSTEPS * DT, gravity=GRAVITY, anchored=False)
    young = torch.full_like(sim.volume, YOUNG, requires_grad=True)
    start = [a.clone().requires_grad_() for a in (sim.x_rest, sim.tensor(v), sim.tensor(F))]
    after = sim.frame(sim.rest(x=start[0], v=start[1], F=start[2]), young, sim.tensor(POISSON), None, 0.7)
    bars = torch.autograd.grad((after.x * sim.tensor(weight)).sum(), (young, *start))
    return after.x.detach().numpy(), *(bar.numpy() for bar in bars)


def test_gradients_equal_those_of_a_full_tape():
    body, rng = block((3, 2, 2), dx=0.02, per_cell=1.5, jitter=0.2), np.random.default_rng(0)
    count = len(body[0].x_rest)
    weight, v, F = rng.normal(size=(count, 3)), 0.3 * rng.normal(size=(count, 3)), np.eye(3) + 0.05 * rng.normal(size=(count, 3, 3))
    peer, tape = prototype(body), wp.Tape()
    peer.states[0][1].assign(v)
    peer.states[0][3].assign(F)
    with tape:
        for n in range(SUBSTEPS):
            for kernel, dim, inputs, outputs in peer.launches(n, peer.nodes()):
                wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device="cpu")
    last = peer.states[-1][0]
    tape.backward(grads={last: wp.array(weight, dtype=peer.kernels.vec3, device="cpu")})
    x, *bars = ours(body, v, F, weight)
    np.testing.assert_allclose(x, last.numpy(), rtol=1e-10)
    of_start = [peer.states[0][part].grad.numpy() for part in (0, 1, 3)]
    for mine, theirs in zip(bars, [peer.gradient(), *of_start], strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-10 * np.abs(theirs).max())
