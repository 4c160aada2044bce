"""The part of the grid that a frame's particles can touch: transfers and grid sweeps run on it alone.

A box is a row of eight integers, made where the particles are: low i j k, size i j k, index of its first node in the
nodal arrays, clamp index within it.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ...types import Grid
from ..substep.common import common
from ..substep.shared_inputs import world_of

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,index,name-defined,operator,valid-type"

COLUMNS = 8
NO_FLAG = 2**62
NOWHERE = (2**30,) * 3 + (-1,) * 3  # extent of no particles


def whole(grid: Grid, simulations: int) -> Tensor:
    """Boxes (simulations, 8) that are all of the grid."""
    row = torch.tensor([0, 0, 0, *grid.size, 0, max(grid.clamp_index, -1)], dtype=torch.int32)
    boxes = row.repeat(simulations, 1)
    boxes[:, 6] = torch.arange(simulations) * int(torch.tensor(grid.size).prod())
    return boxes


def rest_nodes(grid: Grid, x: np.ndarray) -> int:
    """Nodes of the box that `enclosing` makes around particles at rest at x (P, 3) [m]."""
    base = np.floor((x - grid.origin) / grid.dx - 0.5)
    low, high = np.maximum(base.min(0) - 1, 0), np.minimum(base.max(0) + 3, np.asarray(grid.size) - 1)
    return int(np.prod(high - low + 1))


@cache
def enclosing(real: type, bordered: bool) -> SimpleNamespace:
    """Kernels `reach`, over particles, and `settle`, over simulations: boxes with room to move for a frame at the speeds at
    its start, or around the anchors of particles that keep their weights, and a cell more. A box of more nodes than `room`, or of too few, is a single node instead, so that a flag
    rises; the last entry of `flags` says how many the largest would need."""
    t, World = common(real), world_of(real, bordered).World
    nowhere, no_flag = wp.constant(wp.int32(NOWHERE[0])), wp.constant(wp.int64(NO_FLAG))
    recall, get = t.recall, t.get
    module = wp.get_module(f"diffphys_ros.simulate.box_{real.__name__}" + "_bordered" * bordered)
    module.options |= {"enable_backward": False}

    @wp.func
    def clip(u: real, nodes: int, otherwise: int):
        """A node index within the grid."""
        if not wp.isfinite(u):
            return otherwise
        return int(wp.clamp(u, real(0.0), real(nodes - 1)))

    @wp.func
    def widen(extents: wp.array2d(dtype=int), simulation: int, axis: int, u: real, cells: real, nodes: int):
        base, away = wp.floor(u - real(0.5)), wp.ceil(wp.abs(cells)) + real(1.0)  # type: ignore[type-var]
        low, high = clip(base - away, nodes, 0), clip(base + real(2.0) + away, nodes, nodes - 1)
        if low < extents[simulation, axis]:  # most particles are within by now and spare the atomic operation
            wp.atomic_min(extents, simulation, axis, low)
        if high > extents[simulation, 3 + axis]:
            wp.atomic_max(extents, simulation, 3 + axis, high)

    @wp.kernel(enable_backward=False, module=module)
    def reach(world: World, states: t.States, frame_s: real, anchored: int, extents: wp.array2d(dtype=int), flags: wp.array(dtype=wp.int64)):
        p = wp.tid()
        simulation = p // world.particles
        a, b = recall(states, 0, 6 * p), recall(states, 0, 6 * p + 1)
        vx, way_s = a[3], frame_s
        if anchored != 0:
            a, way_s = get(world.materials.anchor, 3 * p), real(0.0)
        o, dx = world.grid.origin, world.grid.dx
        widen(extents, simulation, 0, (a[0] - o[0]) / dx, vx * way_s / dx, world.grid.nx)
        widen(extents, simulation, 1, (a[1] - o[1]) / dx, b[0] * way_s / dx, world.grid.ny)
        widen(extents, simulation, 2, (a[2] - o[2]) / dx, b[1] * way_s / dx, world.grid.nz)
        if p == 0:
            flags[world.drag.shape[0]] = wp.int64(0)

    @wp.kernel(enable_backward=False, module=module)
    def settle(world: World, room: int, extents: wp.array2d(dtype=int), flags: wp.array(dtype=wp.int64)):
        simulation = wp.tid()
        low = wp.vec3i(extents[simulation, 0], extents[simulation, 1], extents[simulation, 2])
        high = wp.vec3i(extents[simulation, 3], extents[simulation, 4], extents[simulation, 5])
        size = high - low + wp.vec3i(1, 1, 1)
        nodes = size[0] * size[1] * size[2]
        if nodes > room or wp.min(size) < 3:
            size = wp.vec3i(1, 1, 1)
        for axis in range(3):
            extents[simulation, axis] = nowhere
            extents[simulation, 3 + axis] = -1
            world.boxes[simulation, axis] = low[axis]
            world.boxes[simulation, 3 + axis] = size[axis]
        world.boxes[simulation, 6] = simulation * room
        world.boxes[simulation, 7] = wp.max(world.grid.clamp_index - low[0], -1)
        flags[simulation] = no_flag
        wp.atomic_max(flags, world.drag.shape[0], wp.int64(nodes))

    return SimpleNamespace(reach=reach, settle=settle)
