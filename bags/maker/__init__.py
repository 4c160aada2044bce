"""Makes the bundled sample with another simulator than ours (MuJoCo). A tool for developers; see make_sample.py."""

import os

os.environ.setdefault("MUJOCO_GL", "osmesa")  # software rendering; read when mujoco is imported
