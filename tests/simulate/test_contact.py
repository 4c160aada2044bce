"""A node's velocity after planes and handle, function by function."""

from functools import cache

import numpy as np
import pytest
import torch
import warp as wp

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import Handle, Plane
from diffphys_ros.simulate.borders import Borders
from diffphys_ros.simulate.substep.common import common
from diffphys_ros.simulate.substep.contact import LANDING, contact

UP = np.array([0.0, 0.6, 0.8])
DT, NODES = 0.01, 36
HANDLE = Handle(low=(0.1, -1.0, -1.0), high=(1.0, 1.0, 1.0))  # holds all that the lattice below has at x > 0.1


@cache
def kernels():
    """Apply meet and its adjoint to every node of a lattice."""
    wp.init()
    t, c = common(wp.float64), contact(wp.float64, True)
    vec3, Lattice, Met = t.vec3, t.Lattice, c.Borders
    module = wp.get_module("diffphys_ros.tests.contact")

    @wp.kernel(enable_backward=False, module=module)
    def forward(lattice: Lattice, borders: Met, v: wp.array(dtype=vec3), out: wp.array(dtype=vec3)):
        n = wp.tid()
        out[n] = c.meet(lattice, borders, 0, n, v[n], borders.near, n * borders.normal.shape[0])

    @wp.kernel(enable_backward=False, module=module)
    def backward(
        lattice: Lattice,
        borders: Met,
        v: wp.array(dtype=vec3),
        bar: wp.array(dtype=vec3),
        out: wp.array(dtype=vec3),
        borders_bar: Met,
    ):
        n = wp.tid()
        near = n * borders.normal.shape[0]
        out[n] = c.meet_adjoint(lattice, borders, 0, n, v[n], bar[n], borders.near, near, borders_bar)

    return forward, backward


def lattice() -> object:
    """4 x 3 x 3 nodes, 0.1 m apart, from (-0.15, -0.1, -0.1) on."""
    t = common(wp.float64)
    made = t.Lattice()
    made.origin, made.dx, made.dt, made.nx, made.ny, made.nz = t.vec3(-0.15, -0.1, -0.1), 0.1, DT, 4, 3, 3
    return made


def nodes() -> np.ndarray:
    axes = [np.arange(n) * 0.1 + o for n, o in ((4, -0.15), (3, -0.1), (3, -0.1))]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def borders(planes: tuple[Plane, ...], friction: torch.Tensor, motion: torch.Tensor, near: torch.Tensor, *, handle: bool) -> object:
    c, t = contact(wp.float64, True), common(wp.float64)
    made = c.Borders()
    made.normal = wp.array(np.array([p.unit_normal for p in planes]).reshape(-1, 3), dtype=t.vec3)
    made.offset = wp.array([p.offset_m for p in planes], dtype=wp.float64)
    made.kind = wp.array([p.kind_index for p in planes], dtype=int)
    made.near = wp.from_torch(near.view(-1, 4), dtype=t.vec4)
    made.friction, made.motion = wp.from_torch(friction[None]), wp.from_torch(motion[None], dtype=c.mat34)
    made.handle_from_body = wp.array(np.eye(4)[None, None, :3], dtype=c.mat34)
    made.low, made.high = (t.vec3(*corner) for corner in Borders(handle=HANDLE if handle else None).box)
    return made


class Meet(torch.autograd.Function):
    """All nodes at once as a torch function of velocities (N, 3), friction (planes,), motion (1, 3, 4) and sums (N, planes, 4)."""

    @staticmethod
    def forward(ctx, v, friction, motion, near, planes, handle):
        out, vec3 = torch.zeros_like(v), common(wp.float64).vec3
        made = borders(planes, friction.detach(), motion.detach(), near.detach(), handle=handle)
        wp.launch(kernels()[0], len(v), [lattice(), made, wp.from_torch(v.detach(), dtype=vec3)], [wp.from_torch(out, dtype=vec3)])
        ctx.save_for_backward(v, friction, motion, near)
        ctx.planes, ctx.handle = planes, handle
        return out

    @staticmethod
    def backward(ctx, bar):
        v, *others = ctx.saved_tensors
        v_bar, *others_bar = (torch.zeros_like(a) for a in (v, *others))
        vec3 = common(wp.float64).vec3
        made, made_bar = (borders(ctx.planes, *(a.detach() for a in some), handle=ctx.handle) for some in (others, others_bar))
        seen = [wp.from_torch(a.detach().contiguous(), dtype=vec3) for a in (v, bar)]
        wp.launch(kernels()[1], len(v), [lattice(), made, *seen], [wp.from_torch(v_bar, dtype=vec3), made_bar])
        return v_bar, *others_bar, None, None


def after(
    v: torch.Tensor, *planes: Plane, handle: bool = False, motion: torch.Tensor | None = None, near: torch.Tensor | None = None
) -> torch.Tensor:
    friction = torch.tensor([p.friction for p in planes], dtype=torch.float64)
    still = torch.zeros(1, 3, 4).double() if motion is None else motion
    return Meet.apply(v, friction, still, at_distance(0.0, len(planes)) if near is None else near, planes, handle)


def at_distance(distance: float | torch.Tensor, planes: int) -> torch.Tensor:
    """Sums of particles (N, planes, 4) that tell of one distance [m], or of one for each node and plane (N, planes)."""
    weight = torch.linspace(0.2, 0.9, NODES * planes, dtype=torch.float64).view(NODES, planes)
    return torch.stack([weight, weight * distance, 0 * weight, 0 * weight], -1)


def velocities(seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(NODES, 3)))


def split(v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Normal component (N,) and tangential part (N, 3) against UP."""
    up = torch.from_numpy(UP)
    return v @ up, v - (v @ up)[:, None] * up


BELOW = torch.from_numpy(nodes() @ UP <= 1e-9)


def test_sticky_planes_stop_their_nodes_and_no_others():
    v = velocities()
    out = after(v, Plane(UP, 0.0, "sticky"))
    assert out[BELOW].abs().max() == 0
    assert torch.equal(out[~BELOW], v[~BELOW])
    assert 0 < BELOW.sum() < len(v)


def test_slip_planes_take_the_normal_velocity_whichever_way_it_points():
    v = velocities()
    normal, along = split(after(v, Plane(5 * UP, 0.0, "slip")))
    assert normal[BELOW].abs().max() < 1e-15
    torch.testing.assert_close(along[BELOW], split(v)[1][BELOW])


def test_separating_planes_let_go_and_rub_by_coulombs_law():
    v = velocities()
    (into, before), (normal, along) = split(v), split(after(v, Plane(UP, 0.0, "separate", 1.2)))
    leaving, pressed = BELOW & (into > 0), BELOW & (into < 0)
    assert torch.equal(normal[leaving], into[leaving])
    assert normal[pressed].abs().max() < 1e-15
    expected = (before.norm(dim=1) + 1.2 * into).clamp_min(0)
    torch.testing.assert_close(along.norm(dim=1)[pressed], expected[pressed])
    assert (expected[pressed] == 0).any(), "some must stick"
    assert (expected[pressed] > 0).any(), "some must slide"


def test_a_separating_plane_lets_material_come_as_near_as_it_is_and_no_faster_than_in_the_landings_substeps():
    v, distance = velocities(), 0.02
    pace = distance / (LANDING * DT)
    normal, along = split(after(v, Plane(UP, 0.0), near=at_distance(distance, 1)))
    into, before = split(v)
    torch.testing.assert_close(normal[BELOW], into.clamp_min(-pace)[BELOW])
    torch.testing.assert_close(along, before)
    assert (into[BELOW] < -pace).any()
    assert ((into[BELOW] > -pace) & (into[BELOW] < 0)).any()
    assert torch.equal(after(v, Plane(UP, 0.0), near=0 * at_distance(1.0, 1)), v), "no material is near"


def test_a_handle_gives_its_nodes_its_own_velocity_also_below_a_floor():
    motion = torch.from_numpy(np.random.default_rng(3).normal(size=(1, 3, 4)))
    v, x = velocities(), torch.from_numpy(nodes())
    out, inside = after(v, Plane(UP, 0.0, "sticky"), handle=True, motion=motion), x[:, 0] > 0.1
    torch.testing.assert_close(out[inside], (x @ motion[0, :, :3].T + motion[0, :, 3])[inside])
    assert torch.equal(out[~inside & ~BELOW], v[~inside & ~BELOW])


@pytest.mark.parametrize("planes", [
    (Plane(UP, 0.0, "slip"),),
    (Plane(UP, 0.0, "separate", 0.4),),
    (Plane(UP, 0.0, "slip", 0.7), Plane((1.0, 0.2, 0.0), -0.05, "separate", 0.3), Plane((0.0, 0.0, 1.0), -0.1, "sticky")),
])  # fmt: skip
def test_adjoints_of_velocity_friction_and_handle_motion_equal_differences(planes):
    friction = torch.tensor([p.friction for p in planes], dtype=torch.float64)
    motion = torch.from_numpy(np.random.default_rng(3).normal(size=(1, 3, 4)))
    inputs = [a.requires_grad_() for a in (velocities(), friction.clone(), motion)]
    frictions = [i for i, p in enumerate(planes) if p.friction > 0]

    distance = torch.from_numpy(np.random.default_rng(5).uniform(-0.01, 0.03, (NODES, len(planes)))).requires_grad_()

    def function(v, rubbing, motion, distance):
        every = friction.detach().index_copy(0, torch.tensor(frictions, dtype=int), rubbing)
        return Meet.apply(v, every, motion, at_distance(distance, len(planes)), planes, True)

    rubbing = inputs[1][frictions].detach().requires_grad_()
    assert torch.autograd.gradcheck(function, (inputs[0], rubbing, inputs[2], distance))


def test_friction_at_zero_has_its_one_sided_derivative():
    v, friction = velocities(), torch.zeros(1, dtype=torch.float64, requires_grad=True)
    weight = velocities(1)
    loss = lambda f: (Meet.apply(v, f, torch.zeros(1, 3, 4).double(), at_distance(0.0, 1), (Plane(UP, 0.0),), False) * weight).sum()  # noqa: E731
    (slope,) = torch.autograd.grad(loss(friction), friction)
    step = torch.tensor([1e-7], dtype=torch.float64)
    assert float(slope) == pytest.approx(float(loss(step) - loss(0 * step)) / 1e-7, rel=1e-5)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Plane((0, 0, 0), 0.0), "normal"),
    (lambda: Plane(UP, 0.0, "rubber"), "choose one of sticky, slip, separate"),
    (lambda: Plane(UP, 0.0, friction=-0.1), "not negative"),
    (lambda: Handle((0, 0, 0), (1, 0, 1)), "low must be below high"),
    (lambda: Handle((0, 0, 0), (1, 1, 1), np.eye(3)), r"shape \(4, 4\)"),
])  # fmt: skip
def test_impossible_borders_are_refused_in_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()
