"""Start values from the body's eigenmodes: forced frames, Young's modulus per part, damping, force.

Reading order: outline, mesh, elements (finite elements of the filled body), interpolation, response, model (its motion in a few
modes), observation (tracks in a few coordinates), support (forced frames), tail (stiffness), force, spread, start; lattice
(apparent stiffness of the solver's grid). scikit-fem is needed by elements alone.
"""

from .lattice import apparent_stiffness
from .model import ModalModel
from .start import start_values

__all__ = ["ModalModel", "apparent_stiffness", "start_values"]
