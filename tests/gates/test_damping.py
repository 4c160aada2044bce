"""A flat bar struck aslant swings fast across its width and slowly across its thickness, braked by mass and stiffness damping alike. With
either left out the other brakes one of the two swings wrongly."""

from __future__ import annotations

from .conftest import Recover

TRACKS_ALONE = ("--experiment.image_weight", "0", "--experiment.depth_weight", "0", "--fit.iterations", "3", "--experiment.splat_iterations", "5", "--experiment.max_splats", "100")


def test_both_swings_are_braked_as_they_were(recovered: Recover) -> None:
    answer = recovered("flat", *TRACKS_ALONE)
    assert answer.trajectory_error < 0.07
    assert abs(answer.log10_young_error[0]) < 0.03
    assert answer.metrics["refined"]
