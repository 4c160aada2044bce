"""What must stand in the environment before rclpy starts."""

from __future__ import annotations

import os
from pathlib import Path

PROFILE = Path(__file__).with_name("fastdds.xml")  # beside this file in every kind of installation
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_OTHERS = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")  # words of the user on transports, which the profile would overrule


def prepare() -> None:
    """Large messages get room in Fast DDS, and idle solver threads sleep; what the user has set stays."""
    if not any(name in os.environ for name in _OTHERS):
        os.environ.setdefault(VARIABLE, str(PROFILE))
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # nodes share a machine: idle solver threads must not spin
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the tensors are small: threads cost more than they give
