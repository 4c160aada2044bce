"""The maker of the sample, where MuJoCo is installed: several seeds meet the same figures."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from tools.sample_maker.bar import BAR, CELLS_ACROSS, draw, draw_flat, draw_strip


@pytest.fixture(scope="module")
def maker() -> Any:
    try:
        return importlib.import_module("tools.sample_maker.__main__")
    except Exception as error:  # mujoco raises what it likes where its renderer's library is missing
        pytest.skip(f"the maker needs mujoco and libosmesa6 ({error})")


@pytest.mark.parametrize("seed", range(8))
def test_nodes_share_the_volume_and_parts_meet_at_a_third(seed: int) -> None:
    bar = draw(np.random.default_rng(seed))
    assert bar.volume.sum() == pytest.approx(bar.size.prod())
    assert bar.part_volume[0].sum() / bar.volume.sum() == pytest.approx(BAR.cells_inner / BAR.cells_long)
    clamped = bar.part_volume[:, bar.clamped].sum(1)
    assert clamped[0] > 0
    assert clamped[1] == 0
    assert bar.clamped.sum() == (2 * CELLS_ACROSS + 1) ** 2
    assert bar.substeps <= 60
    assert 300 <= bar.particles <= 650
    assert abs(bar.push[bar.axis]) == 0


@pytest.mark.parametrize("drawn", [draw_flat, draw_strip])
def test_a_bar_of_one_part_has_one_material_everywhere(drawn: Any) -> None:
    bar = drawn(np.random.default_rng(0))
    assert bar.shape.parts == len(bar.young) == 1
    assert not bar.cell_part.any()
    assert bar.volume.sum() == pytest.approx(bar.size.prod())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_seed_gives_a_clip_that_tells_both_parts_apart(maker: Any, seed: int) -> None:
    body, frequencies = maker.prepare(seed)
    frames = maker.clip_frames(body.bar, frequencies[0])
    assert 36 <= frames <= BAR.most_frames
    free_periods = (frames - 1 - np.ceil(body.bar.gust_end * maker.FPS)) / maker.FPS * frequencies[0]
    assert free_periods >= 1.3
    for factors in ([1.25, 1.0], [1.0, 1.25]):
        assert body.frequencies(body.bar.young * factors)[0] / frequencies[0] >= 1.01


def test_frequencies_follow_the_root_of_stiffness(maker: Any) -> None:
    body, frequencies = maker.prepare(1)
    np.testing.assert_allclose(body.frequencies(4 * body.bar.young), 2 * frequencies, rtol=1e-6)
