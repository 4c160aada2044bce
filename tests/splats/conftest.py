"""Free Gaussians that tests share."""

import numpy as np
import pytest

from diffphys_ros.splats.ellipsoids import ellipsoids_of
from diffphys_ros.types import Splats


@pytest.fixture
def some():
    rng = np.random.default_rng(3)
    rotation = rng.standard_normal((12, 4))
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    arrays = (rng.normal(0, 1, (12, 3)), rotation, rng.uniform(0.01, 0.1, (12, 3)), rng.uniform(0.3, 0.9, 12), rng.uniform(0, 1, (12, 3)))
    return ellipsoids_of(Splats(*(a.astype(np.float32) for a in arrays)), "cpu")
