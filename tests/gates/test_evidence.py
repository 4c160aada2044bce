"""Each kind of evidence recovers the strip by itself: one that were left out of the fit would leave the start values' motion, .16 to .20 off."""

from __future__ import annotations

from .conftest import Answer, Recover
from .test_strip import COSINE, YOUNG

FALSE_FORCE = 0.1  # twice that of all evidence together
TRACKS, DEPTH, IMAGES = "--experiment.track_weight", "--experiment.depth_weight", "--experiment.image_weight"
NO_PICTURES = ("--experiment.splat_iterations", "5", "--experiment.max_splats", "100")
FEW_PARTICLES = ("--experiment.per_cell", "1.5")  # a third; pictures and depth need more to draw the strip with
FEW_GAUSSIANS = ("--experiment.splat_iterations", "100", "--experiment.max_splats", "60")  # so large that each must turn with the strip
FEWER_GAUSSIANS = ("--experiment.splat_iterations", "100", "--experiment.max_splats", "40")  # with 60 that do not turn a search still gets there
POINTS, SURFACE, PICTURE = 0.06, 0.12, 0.15  # bounds of the trajectory's error by tracks, depth and colours alone


def check(answer: Answer, trajectory: float) -> None:
    assert answer.trajectory_error < trajectory
    assert abs(answer.log10_young_error[0]) < YOUNG
    assert answer.metrics["net_force_cosine"] > COSINE
    assert answer.metrics["false_force_ratio"] < FALSE_FORCE
    assert answer.metrics["refined"]


def test_tracks_alone_recover_the_strip(recovered: Recover) -> None:
    check(recovered("strip", IMAGES, "0", DEPTH, "0", "--fit.iterations", "6", *NO_PICTURES, *FEW_PARTICLES), POINTS)


def test_depth_alone_recovers_the_strip(recovered: Recover) -> None:
    check(recovered("strip", TRACKS, "0", IMAGES, "0", DEPTH, "1", "--fit.iterations", "5", "--experiment.image_every", "5"), SURFACE)


def test_squared_colour_differences_alone_recover_the_strip_with_gaussians_that_turn(recovered: Recover) -> None:
    check(recovered("strip", TRACKS, "0", DEPTH, "0", "--experiment.ssim_weight", "0", "--fit.iterations", "8", *FEWER_GAUSSIANS), PICTURE)


def test_structural_similarity_alone_recovers_the_strip_though_its_light_fades(recovered: Recover) -> None:
    check(recovered("fading", TRACKS, "0", DEPTH, "0", "--experiment.ssim_weight", "1000", "--fit.iterations", "8", *FEW_GAUSSIANS), PICTURE)
