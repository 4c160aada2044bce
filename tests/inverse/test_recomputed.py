"""Claims about parts of a computation that are done again on the way back."""

from __future__ import annotations

import torch

from diffphys_ros.inverse.evidence.recomputed import recomputed


def part(a: torch.Tensor, b: torch.Tensor, c: torch.Tensor) -> tuple[torch.Tensor, ...]:
    return (a * b).sin().sum(), (a > 0).sum(), (a**3).sum() + 0 * c.sum(), c.sum()


def tensors() -> list[torch.Tensor]:
    rng = torch.Generator().manual_seed(0)
    return [torch.randn(5, generator=rng, dtype=torch.float64, requires_grad=needed) for needed in (True, True, False)]


def test_results_and_gradients_are_those_of_the_part_itself() -> None:
    for chosen in ((0,), (2,), (0, 2)):  # of the results, those that something is made of
        one, two = tensors(), tensors()
        direct, again = part(*one), recomputed(part, *two)
        for left, right in zip(direct, again, strict=True):
            torch.testing.assert_close(left, right, rtol=0, atol=0)
        assert not again[1].requires_grad
        sum((k + 2) * direct[k] for k in chosen).backward()
        sum((k + 2) * again[k] for k in chosen).backward()
        for left, right in zip(one, two, strict=True):
            assert (left.grad is None or not left.grad.any()) == (right.grad is None or not right.grad.any())
            if left.grad is not None and right.grad is not None:
                torch.testing.assert_close(left.grad, right.grad, rtol=0, atol=0)


def test_nothing_of_the_part_is_kept() -> None:
    kept: list[torch.Tensor] = []
    with torch.autograd.graph.saved_tensors_hooks(lambda tensor: kept.append(tensor) or tensor, lambda tensor: tensor):
        own = tensors()
        recomputed(part, *own)
    assert all(any(tensor is each for each in own) for tensor in kept)
    assert len(kept) == len(own)
