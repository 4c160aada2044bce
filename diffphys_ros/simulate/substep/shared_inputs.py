"""What the substeps of a frame share, for all simulations of a batch, and what their code is built for."""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import warp as wp

from .common import common
from .contact import contact

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,valid-type"


@dataclass(frozen=True)
class Variant:
    """What the code of a substep is built for."""

    law: str  # name in laws.LAWS
    real: type  # wp.float32 or wp.float64
    nodal: bool  # a force density on the nodes acts too
    bordered: bool  # nodes meet planes and a handle
    planes: int  # that nodes have places for
    anchored: bool  # particles keep the weights of their anchor

    @property
    def pitch(self) -> int:
        """4-vectors per node of a velocity grid: borders keep the velocity before them and sums for each plane, too."""
        return 2 + self.planes if self.bordered else 1

    @property
    def label(self) -> str:
        """Name of the variant in module names."""
        flags = "_anchored" * self.anchored + "_nodal" * self.nodal + f"_bordered_{self.planes}" * self.bordered
        return f"{self.law}_{self.real.__name__}{flags}"


@cache
def world_of(real: type, bordered: bool) -> SimpleNamespace:
    """The struct World, which also holds the adjoints of the same, and `lattice_of(world, simulation)`."""
    t, Borders = common(real), contact(real, bordered).Borders
    vec3, Lattice, Materials = t.vec3, t.Lattice, t.Materials

    @wp.struct
    class World:
        grid: Lattice  # the whole grid
        boxes: wp.array2d(dtype=int)  # of each simulation, see box.py
        particles: int  # of one simulation
        materials: Materials
        borders: Borders
        drag: wp.array(dtype=real)  # of each simulation; its adjoint: of each node
        start: wp.array(dtype=int)  # number of the first substep

    @wp.func
    def lattice_of(world: World, simulation: int):
        boxes, lattice = world.boxes, world.grid
        lattice.low = vec3(real(boxes[simulation, 0]), real(boxes[simulation, 1]), real(boxes[simulation, 2]))
        lattice.simulation = simulation
        lattice.nx = boxes[simulation, 3]
        lattice.ny = boxes[simulation, 4]
        lattice.nz = boxes[simulation, 5]
        lattice.base = boxes[simulation, 6]
        lattice.clamp_index = boxes[simulation, 7]
        return lattice

    return SimpleNamespace(World=World, Borders=Borders, lattice_of=lattice_of)
