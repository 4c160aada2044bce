"""Explicit, differentiable MLS-MPM in Warp, CPU and CUDA from one source; torch outside (paper section 3.3)."""

from .damping import ModalDamping
from .stability import max_young, substeps_per_frame
from .state import State
from .transition import Simulator

__all__ = ["ModalDamping", "Simulator", "State", "max_young", "substeps_per_frame"]
