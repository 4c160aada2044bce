"""Descent over tensors, on functions whose minimum is known."""

import weakref
from collections.abc import Callable, Iterator
from itertools import islice, pairwise

import numpy as np
import pytest
import torch

from diffphys_ros.inverse.descent import Descent, Rules, Space, begin, descend

LONG = Rules(memory=15, patience=None)  # as for fields


def begun(space: Space, loss: Callable[[], torch.Tensor], rules: Rules = LONG) -> Iterator[Descent]:
    state = begin(space, loss())
    yield state
    yield from descend(space, loss, state, rules)


def losses(steps, count: int) -> list[float]:
    return [state.value for state in islice(steps, count)]


def rosenbrock(x: torch.Tensor) -> torch.Tensor:
    return (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2


def test_a_quadratic_of_condition_one_thousand_is_solved_over_two_tensors_of_other_types():
    first, second = torch.nn.Parameter(torch.ones(10, dtype=torch.float64)), torch.nn.Parameter(torch.ones(2, 5))
    stiffness = torch.logspace(0, 3, 20, dtype=torch.float64)

    def loss() -> torch.Tensor:
        x = torch.cat([first, second.double().reshape(-1)])
        return 0.5 * (stiffness * (x - 0.5) ** 2).sum()

    values = losses(begun(Space([first, second]), loss), 80)
    assert values == sorted(values, reverse=True)
    assert values[-1] < 1e-6 * values[0]
    assert float((first.detach() - 0.5).abs().max()) < 2e-2


def test_a_curved_valley_is_followed_to_its_end():
    x = torch.nn.Parameter(torch.tensor([-1.2, 1.0], dtype=torch.float64))
    values = losses(begun(Space([x]), lambda: rosenbrock(x)), 80)
    assert values[-1] < 1e-10
    assert x.detach().numpy() == pytest.approx([1.0, 1.0], abs=1e-4)


def test_where_the_loss_is_infinite_no_step_ends():
    x = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64))

    def loss() -> torch.Tensor:
        return (x - 3.0).square().sum() if float(x.detach()) < 2.0 else torch.tensor(float("inf"))

    values = losses(begun(Space([x]), loss), 30)
    assert values == sorted(values, reverse=True)
    assert 1.5 < float(x.detach()) < 2.0


def test_at_a_minimum_it_stops_and_leaves_the_tensors_there():
    x = torch.nn.Parameter(torch.tensor([2.0]))
    assert losses(begun(Space([x]), lambda: (x - 2.0).square().sum()), 9) == [0.0]
    assert float(x.detach()) == 2.0


def test_a_tensor_that_the_loss_does_not_know_stays():
    x, idle = torch.nn.Parameter(torch.tensor([2.0])), torch.nn.Parameter(torch.tensor([7.0]))
    list(islice(begun(Space([x, idle]), lambda: x.square().sum()), 10))
    assert float(idle.detach()) == 7.0
    assert abs(float(x.detach())) < 1e-3


def test_a_start_without_a_loss_is_told_and_left():
    x = torch.nn.Parameter(torch.tensor([2.0]))
    assert losses(begun(Space([x]), lambda: torch.tensor(float("inf"))), 9) == [float("inf")]


def test_a_descent_that_was_interrupted_goes_on_to_the_same_bits():
    def at_start() -> torch.Tensor:
        return torch.nn.Parameter(torch.tensor([-1.2, 1.0]))

    whole, broken, later = at_start(), at_start(), at_start()
    states = list(islice(begun(Space([whole]), lambda: rosenbrock(whole)), 25))
    *_, half = islice(begun(Space([broken]), lambda: rosenbrock(broken)), 12)
    Space([later]).assign(half.at)
    rest = list(islice(descend(Space([later]), lambda: rosenbrock(later), half, LONG), 13))
    assert [s.value for s in states[12:]] == [s.value for s in rest]
    assert torch.equal(whole, later)


def ill_conditioned(n: int = 6) -> np.ndarray:
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return q @ np.diag(np.geomspace(1, 1e4, n)) @ q.T


class Bowl:
    """0.5 (z - 1)^T H (z - 1) from z = 0."""

    def __init__(self, hessian: np.ndarray) -> None:
        self.z, self.hessian = torch.nn.Parameter(torch.zeros(len(hessian), dtype=torch.float64)), torch.from_numpy(hessian)

    def __call__(self) -> torch.Tensor:
        return 0.5 * (self.z - 1) @ self.hessian @ (self.z - 1)

    def states(self, rules: Rules, count: int) -> list[Descent]:
        return list(islice(begun(Space([self.z]), self, rules), count))


def test_the_true_inverse_hessian_as_metric_reaches_the_minimum_in_one_step() -> None:
    hessian = ill_conditioned()
    *_, state = Bowl(hessian).states(Rules(np.linalg.inv(hessian)), 2)
    np.testing.assert_allclose(state.at, 1, atol=1e-10)


def test_a_metric_wrong_by_a_factor_is_learnt() -> None:
    hessian = ill_conditioned()
    *_, last = Bowl(hessian).states(Rules(np.linalg.inv(0.3 * hessian)), 31)
    assert last.value < 1e-6 * 0.5 * np.ones(6) @ hessian @ np.ones(6)


def test_with_all_steps_remembered_it_is_bfgs() -> None:
    """The direction is that of the inverse Hessian which the update of Broyden, Fletcher, Goldfarb and Shanno makes."""
    hessian, metric = ill_conditioned(), np.eye(6) / 50
    states = Bowl(hessian).states(Rules(metric), 5)
    inverse = metric
    for before, after in pairwise(states[:-1]):
        step, change = after.at - before.at, after.slope - before.slope
        left = np.eye(6) - np.outer(step, change) / (step @ change)
        inverse = left @ inverse @ left.T + np.outer(step, step) / (step @ change)
    direction = states[-1].at - states[-2].at
    expected = -inverse @ states[-2].slope
    np.testing.assert_allclose(direction / np.linalg.norm(direction), expected / np.linalg.norm(expected), atol=1e-9)


def test_the_limit_shortens_a_step() -> None:
    *_, state = Bowl(np.eye(2)).states(Rules(np.eye(2), limit=lambda at, step: 0.5), 2)
    np.testing.assert_allclose(state.at, 0.5)


def test_no_progress_ends_it() -> None:
    z = torch.nn.Parameter(torch.tensor([3.0], dtype=torch.float64))
    states = list(begun(Space([z]), lambda: 1000.0 + 1e-6 * z.square().sum(), Rules(np.eye(1))))
    assert len(states) <= 3


def test_a_direction_that_leads_uphill_is_forgotten_and_then_ends_it() -> None:
    z = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64))
    *_, last = begun(Space([z]), lambda: z.square().sum(), Rules(-np.eye(1), patience=None))
    assert last.finished
    assert float(z.detach()) == 1.0


def test_a_step_that_is_not_taken_is_forgotten_before_the_next_one_is_tried():
    """With its history, which is the largest thing that a fit holds."""
    x, earlier, alive = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64)), list[weakref.ref](), list[bool]()

    def loss() -> torch.Tensor:
        alive.append(any(ref() is not None for ref in earlier))
        made = (x - 3.0).square().sum() + 1e4 * torch.relu(x - 1.001).sum()
        earlier.append(weakref.ref(made))
        return made

    space = Space([x])
    state = begin(space, loss())
    next(descend(space, loss, state, LONG))
    assert len(alive) > 2
    assert not any(alive)
