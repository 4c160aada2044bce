"""A part of a computation of which only the arguments are kept; on the way back it is done again (Griewank and Walther 2000: reverse mode by
checkpoints). torch.utils.checkpoint does so too, but its first use imports torch's compiler, which costs every run two seconds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

Part = Callable[..., tuple[torch.Tensor, ...]]


def recomputed(part: Part, *tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """part(*tensors), differentiable by these tensors alone: what else `part` looks at must not need a gradient, and it must give the same when asked again."""
    return tuple(_Recomputed.apply(part, *tensors))


class _Recomputed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, part: Part, *tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        ctx.part = part
        ctx.save_for_backward(*tensors)
        results = tuple(part(*tensors))
        ctx.mark_non_differentiable(*(result for result in results if not result.is_floating_point()))
        return results

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        needed = ctx.needs_input_grad[1:]
        tensors = [tensor.detach().requires_grad_(need) for tensor, need in zip(ctx.saved_tensors, needed, strict=True)]
        with torch.enable_grad():
            results = ctx.part(*tensors)
            by = [(result * gradient).sum() for result, gradient in zip(results, gradients, strict=True) if result.requires_grad]
            # of a number: gradients of results, told to grad, have it import sympy
            found = iter(torch.autograd.grad(sum(by[1:], by[0]), [tensor for tensor in tensors if tensor.requires_grad], allow_unused=True))
        return None, *(next(found) if need else None for need in needed)
