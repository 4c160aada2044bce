"""The first answer, by the linear engine alone: Young's modulus per part, damping and force.

Reading order: free_tail (stiffness from the motion after the force), force, uncertainty, values (all of it); no_free_tail (force and
stiffness together); zone_layout and zones (a modulus per zone).
"""

from .values import start_values

__all__ = ["start_values"]
