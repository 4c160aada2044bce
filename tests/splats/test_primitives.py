"""Claims about the descent that both fits of Gaussians share."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffphys_ros.splats.descent import DescentPlan, ShrinkingAdam

RATES, LAST, ITERATIONS = {"color": 0.005, "place": 0.1}, 0.1, 20


@dataclass(frozen=True)
class Spots:
    color: torch.Tensor
    place: torch.Tensor

    @property
    def unknowns(self) -> dict[str, torch.Tensor]:
        return vars(self)


def spots() -> Spots:
    generator = torch.Generator().manual_seed(0)
    return Spots(torch.rand(30, 3, generator=generator).requires_grad_(True), torch.randn(30, 4, generator=generator).requires_grad_(True))


def loss_of(what: Spots, k: int) -> torch.Tensor:
    weight = torch.rand(30, 4, generator=torch.Generator().manual_seed(k))
    return ((what.place * weight).sin() ** 2).sum() + ((what.color - 1.2 * weight[:, :3]) ** 2).sum()


def test_steps_are_those_of_torchs_adam() -> None:
    ours, theirs, begun = spots(), spots(), 3
    descent = ShrinkingAdam(DescentPlan(ITERATIONS, RATES, LAST, 0.0, 0))
    descent.begin(ours, begun)
    share = LAST ** (begun / ITERATIONS)
    adam = torch.optim.Adam([{"params": [t], "lr": share * RATES[name]} for name, t in theirs.unknowns.items()], eps=1e-15)
    for k in range(10):
        descent.step(loss_of(ours, k))
        adam.zero_grad()
        loss_of(theirs, k).backward()
        adam.step()
        with torch.no_grad():
            theirs.color.clamp_(0, 1)
        for group in adam.param_groups:
            group["lr"] *= LAST ** (1 / ITERATIONS)
    for name, t in ours.unknowns.items():
        torch.testing.assert_close(t, theirs.unknowns[name], rtol=1e-6, atol=1e-8)
    assert float((ours.place - spots().place).detach().abs().max()) > 0.1
