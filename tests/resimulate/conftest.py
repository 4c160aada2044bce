"""First answers on coarser elements than a user's, in half the time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.coarse import coarse_elements


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with coarse_elements():
        yield
