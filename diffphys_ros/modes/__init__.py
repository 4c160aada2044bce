"""Start values from the body's eigenmodes: forced frames, Young's modulus per part, damping, force.

Reading order: outline, mesh, elements (finite elements of the filled body), interpolation, response, model (its motion in a few
modes), observation (tracks in a few coordinates), support (forced frames), tail (stiffness), force, spread, start, joint (no free tail).
scikit-fem is needed by elements alone.
"""

from .model import ModalModel
from .start import start_values

__all__ = ["ModalModel", "start_values"]
