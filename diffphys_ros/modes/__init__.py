"""Engine 1: small motions of a body in a few eigenmodes; linear, milliseconds, with its Jacobian. numpy only.

Reading order: interpolation (in quadratic tetrahedra), response (of damped oscillators), model.
"""

from .model import ModalModel

__all__ = ["ModalModel"]
