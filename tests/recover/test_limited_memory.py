"""L-BFGS over tensors, on functions whose minimum is known."""

from itertools import islice

import pytest
import torch

from diffphys_ros.recover.limited_memory import Space, descend


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

    values = losses(descend(Space([first, second]), loss), 80)
    assert values == sorted(values, reverse=True)
    assert values[-1] < 1e-6 * values[0]
    assert float((first.detach() - 0.5).abs().max()) < 2e-2


def test_a_curved_valley_is_followed_to_its_end():
    x = torch.nn.Parameter(torch.tensor([-1.2, 1.0], dtype=torch.float64))
    values = losses(descend(Space([x]), lambda: rosenbrock(x)), 80)
    assert values[-1] < 1e-10
    assert x.detach().numpy() == pytest.approx([1.0, 1.0], abs=1e-4)


def test_where_the_loss_is_infinite_no_step_ends():
    x = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64))

    def loss() -> torch.Tensor:
        return (x - 3.0).square().sum() if float(x.detach()) < 2.0 else torch.tensor(float("inf"))

    values = losses(descend(Space([x]), loss), 30)
    assert values == sorted(values, reverse=True)
    assert 1.5 < float(x.detach()) < 2.0


def test_at_a_minimum_it_stops_and_leaves_the_tensors_there():
    x = torch.nn.Parameter(torch.tensor([2.0]))
    assert losses(descend(Space([x]), lambda: (x - 2.0).square().sum()), 9) == [0.0]
    assert float(x.detach()) == 2.0


def test_a_tensor_that_the_loss_does_not_know_stays():
    x, idle = torch.nn.Parameter(torch.tensor([2.0])), torch.nn.Parameter(torch.tensor([7.0]))
    list(islice(descend(Space([x, idle]), lambda: x.square().sum()), 10))
    assert float(idle.detach()) == 7.0
    assert abs(float(x.detach())) < 1e-3


def test_a_start_without_a_loss_is_told_and_left():
    x = torch.nn.Parameter(torch.tensor([2.0]))
    assert losses(descend(Space([x]), lambda: torch.tensor(float("inf"))), 9) == [float("inf")]


def test_a_descent_that_was_interrupted_goes_on_to_the_same_bits():
    def at_start() -> torch.Tensor:
        return torch.nn.Parameter(torch.tensor([-1.2, 1.0]))

    whole, broken, later = at_start(), at_start(), at_start()
    states = list(islice(descend(Space([whole]), lambda: rosenbrock(whole)), 25))
    *_, half = islice(descend(Space([broken]), lambda: rosenbrock(broken)), 12)
    Space([later]).assign(half.at)
    rest = list(islice(descend(Space([later]), lambda: rosenbrock(later), half), 13))
    assert [s.value for s in states[12:]] == [s.value for s in rest]
    assert torch.equal(whole, later)
