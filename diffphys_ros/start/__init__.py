"""The first answer, by the linear engine alone: Young's modulus per part, damping and force.

Reading order: evidence, free_tail (the problem of the free frames), along and force (the problem of all frames), place, expected (of a force along the body), stages (what is fitted after what),
uncertainty, values (all of it), freed (by the free frames that only a fit with force shows); landed (of what is thrown onto a floor); zone_layout, zones (a modulus per zone) and borders (of materials that look alike).
"""

from .borders import parted_by_stiffness
from .freed import freed_values
from .landed import landed_values
from .values import joint_values, joint_wanted, start_values

__all__ = ["freed_values", "joint_values", "joint_wanted", "landed_values", "parted_by_stiffness", "start_values"]
