"""First answers on coarser elements than a user's, in half the time; and the bar that the tests of forces share."""

from __future__ import annotations

import pytest

from diffphys_ros.modes import ModalModel
from diffphys_ros.types import Body
from tests.coarse import coarse
from tests.made_bar import YOUNG, bar, modes_of

__all__ = ["coarse"]


@pytest.fixture(scope="module")
def body() -> Body:
    """Three times as long as high: a force along it stretches it by as much as some noise."""
    return bar(pitch=2e-3)


@pytest.fixture(scope="module")
def modal(body: Body) -> ModalModel:
    return modes_of(body, YOUNG)
