"""Makes the bundled samples with another simulator than ours (MuJoCo): `python -m tools.sample_maker --help`, in a checkout."""

import os

os.environ.setdefault("MUJOCO_GL", "osmesa")  # software rendering; read when mujoco is imported
