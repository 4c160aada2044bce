"""First answers on coarser elements than a user's, in half the time; what elements do to frequencies is tested in tests/elements."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from diffphys_ros.elements import mesh

VERTICES = 32  # aimed at in the plane


@pytest.fixture(scope="module", autouse=True)
def coarse_elements() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh, "TRIANGLE_VERTICES", VERTICES)
        yield
