"""Explicit, differentiable MLS-MPM in Warp, CPU and CUDA from one source; torch outside (paper section 3.3)."""

from .borders import Handle, Plane
from .damping import ModalDamping
from .force_lattice import ForceLattice
from .handle import substep_poses
from .lattice_modes import lattice_modes
from .node_set import NodeSet
from .stability import max_young, substeps_per_frame
from .state import State
from .transition import Push, Simulator

__all__ = [
    "ForceLattice",
    "Handle",
    "ModalDamping",
    "NodeSet",
    "Plane",
    "Push",
    "Simulator",
    "State",
    "lattice_modes",
    "max_young",
    "substep_poses",
    "substeps_per_frame",
]
