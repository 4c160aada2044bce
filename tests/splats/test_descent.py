"""The one fit: how the number of Gaussians changes on the way, whatever their parametrisation."""

import numpy as np
import pytest
import torch

from diffphys_ros.splats import View
from diffphys_ros.splats.descent import DescentPlan, descend
from diffphys_ros.splats.discs import discs_of
from diffphys_ros.splats.ellipsoids import ellipsoids_of
from diffphys_ros.splats.fit import RATES as DISCS
from diffphys_ros.splats.group import groups_of
from diffphys_ros.splats.multi_view import RATES as ELLIPSOIDS
from diffphys_ros.splats.primitives import as_splats
from diffphys_ros.splats.seed import gather_blocks, surface_at

from . import made

VIEW = View(made.image(), made.camera(), made.mask().astype(np.uint8))


@pytest.fixture(params=["discs", "ellipsoids"])
def start(request):
    """The same Gaussians in either parametrisation, and steps of its unknowns."""
    blocks = gather_blocks(made.image() / 255, made.mask(), 90)
    discs = discs_of(blocks, surface_at(blocks.centre, made.depth(), made.mask(), made.camera()), "cpu").leaves()
    if request.param == "discs":
        return discs, DISCS
    mean, rotation, *shared = discs.standing([VIEW])(discs, [0])
    return ellipsoids_of(as_splats((mean[0], rotation[0], *shared)), "cpu"), ELLIPSOIDS


def fitted(start, counts, iterations=8):
    """Losses and Gaussians."""
    what, rates = start
    steps, losses = descend(what.leaves(), groups_of([VIEW], "cpu"), DescentPlan(iterations, rates, 0.1, 0.2, 0, counts)), []
    while True:
        try:
            losses.append(next(steps)[2])
        except StopIteration as stop:
            return losses, stop.value


def test_a_fit_of_one_number_keeps_its_gaussians_and_comes_nearer(start):
    losses, what = fitted(start, {})
    assert len(what) == len(start[0])
    assert losses[-1] < losses[0]


def test_there_are_at_most_as_many_as_the_last_count_allows(start):
    most = len(start[0]) + 30
    assert len(fitted(start, {2: most - 10, 5: most})[1]) == most


def test_until_the_first_count_a_fit_is_the_one_without(start):
    plain, growing = (fitted(start, counts)[0] for counts in ({}, {5: 200}))
    assert plain[:5] == growing[:5]
    assert plain[5:] != growing[5:]


def test_what_the_fit_does_not_change_is_settled_whenever_the_number_changes(start):
    asked = []

    def settled(what):
        asked.append(len(what))
        return what

    what, rates = start
    list(descend(what, groups_of([VIEW], "cpu"), DescentPlan(6, rates, 0.1, 0.2, 0, {2: 95, 4: 99}), settled=settled))
    assert asked == [95, 99]


def test_steps_shrink_to_the_last_rate(start):
    """A last rate near nothing leaves the unknowns where they were after the first steps."""
    what, rates = start
    groups, moved = groups_of([VIEW], "cpu"), []
    for last in (1.0, 1e-6):
        steps = descend(what.leaves(), groups, DescentPlan(10, rates, last, 0.2, 0))
        while True:
            try:
                next(steps)
            except StopIteration as stop:
                moved.append(float((stop.value.log_scale.detach() - what.log_scale.detach()).abs().mean()))
                break
    assert moved[1] < 0.5 * moved[0]
    assert torch.isfinite(torch.tensor(moved)).all()
