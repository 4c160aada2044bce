"""Coarser finite elements than a user's, for tests of what is done with the modes; what elements do to frequencies is tested in tests/elements."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from diffphys_ros.elements import mesh

VERTICES = 32  # aimed at in the plane


@contextmanager
def coarse_elements() -> Iterator[None]:
    """As long as it is open, bodies of this process are cut into so few elements."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh, "TRIANGLE_VERTICES", VERTICES)
        yield


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """For every test of a folder whose conftest imports it."""
    with coarse_elements():
        yield
