"""The flat solid that moves far: against beams, rigid turns and its own differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.elements.plane import DivergedError, FlatSolid
from diffphys_ros.types import Body

LENGTH, WIDTH, SPECIFIC, GRAVITY = 0.1, 0.01, 100.0, 9.81


def bar(length: float = LENGTH, width: float = WIDTH, cells: int = 40) -> Body:
    """A clamped bar along x under gravity along x."""
    pitch = width / cells
    nx, ny = round(length / pitch), cells
    inside = np.zeros((nx + 12, ny + 12), bool)
    inside[:nx, 6 : 6 + ny] = True
    origin = np.array([pitch / 2, -(ny + 11) / 2 * pitch])
    return Body(np.eye(4), inside, origin, pitch, np.where(inside, 0.005, 0.0), np.ones(inside.shape, np.uint8), np.array([1000.0]), np.array([0.3]), np.array([GRAVITY, 0, 0]), True)


@pytest.fixture(scope="module")
def plane() -> FlatSolid:
    return FlatSolid.of(bar())


def still(plane: FlatSolid) -> np.ndarray:
    return np.zeros(2 * len(plane.nodes))


def test_it_swings_as_a_beam_with_shear_and_rotation(plane: FlatSolid) -> None:
    thin = 1.8751041**2 / (2 * np.pi) * np.sqrt(SPECIFIC * WIDTH**2 / 12) / LENGTH**2
    slender = WIDTH**2 / 12 / LENGTH**2 * 4.648 * (1 + 2.6 / 0.85)
    assert plane.frequency(SPECIFIC, still(plane)) == pytest.approx(thin / np.sqrt(1 + slender), rel=0.006)


def test_gravity_stiffens_what_hangs_by_its_own_share(plane: FlatSolid) -> None:
    hanging = plane.frequency(SPECIFIC, plane.weight(np.array([GRAVITY, 0.0])))
    square = hanging**2 - plane.frequency(SPECIFIC, still(plane)) ** 2
    assert square == pytest.approx(1.571 * GRAVITY / LENGTH / (2 * np.pi) ** 2, rel=0.04)  # Rayleigh, with the mode of a beam without weight


def test_a_rigid_turn_strains_nothing(plane: FlatSolid) -> None:
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    forces, _ = plane.inner((plane.nodes @ turn.T - plane.nodes).ravel())
    assert np.abs(forces).max() < 1e-12


@pytest.mark.parametrize(("softens", "power"), [(0.0, 1.0), (8.0, 1.0), (8.0, 1.4), (8.0, 2.0)])
def test_the_tangent_is_the_slope_of_the_forces(plane: FlatSolid, softens: float, power: float) -> None:
    plane = replace(plane, softens=softens, power=power)
    rng = np.random.default_rng(0)
    u, direction = (3e-4 * rng.standard_normal(2 * len(plane.nodes)) for _ in range(2))
    step = 1e-5
    slope = (plane.inner(u + step * direction)[0] - plane.inner(u - step * direction)[0]) / (2 * step)
    assert plane.inner(u)[1] @ direction == pytest.approx(slope, rel=1e-6, abs=1e-9 * np.abs(slope).max())


def test_a_load_is_carried_by_the_clamp(plane: FlatSolid) -> None:
    load = plane.weight(np.array([GRAVITY, 1.0]))
    forces = SPECIFIC * plane.inner(plane.balanced(SPECIFIC, load, still(plane)))[0]
    carried = (load - forces).reshape(-1, 2)[plane.held].sum(0)
    assert carried == pytest.approx(LENGTH * WIDTH * np.array([GRAVITY, 1.0]), rel=0.01)


def test_a_free_swing_keeps_its_energy_and_drag_takes_its_share(plane: FlatSolid) -> None:
    load = plane.weight(np.array([GRAVITY, 0.0]))
    rest = plane.balanced(SPECIFIC, load, still(plane))
    hz, shape = plane.slowest(SPECIFIC, load, rest)
    tip = 2 * int(plane.nodes[:, 0].argmax()) + 1
    begun, step_s = rest + shape * 0.01 / shape[tip], 1 / (90 * hz)
    ratio = []
    for drag in (0.0, 2.0):
        u = plane.march(SPECIFIC, load, begun, 0 * rest, drag_per_s=drag, step_s=step_s, steps=190)
        ratio.append(np.abs(u[150:, tip]).max() / 0.01)
    assert ratio[0] == pytest.approx(1.0, abs=0.01)
    assert ratio[1] / ratio[0] == pytest.approx(np.exp(-0.5 * 2.0 * 2 / hz), rel=0.01)


def test_an_element_that_is_turned_inside_out_is_refused_and_never_entered(plane: FlatSolid) -> None:
    crushed = still(plane)
    crushed[::2] = -1.5 * plane.nodes[:, 0]
    with pytest.raises(DivergedError, match="inside out"):
        plane.inner(crushed)
    pressed = plane.balanced(SPECIFIC, plane.weight(np.array([-40 * GRAVITY, 0.0])), still(plane))
    plane.inner(pressed)  # is sound


def test_what_gives_way_is_softer_by_its_share_of_the_strain(plane: FlatSolid) -> None:
    """Pulled along by a twentieth of its length at the clamp, on the mean a fortieth."""
    load = plane.weight(np.array([0.05 * SPECIFIC / LENGTH, 0.0]))
    tip = 2 * int(plane.nodes[:, 0].argmax())
    stretch = [replace(plane, softens=share).balanced(SPECIFIC, load, still(plane))[tip] for share in (0.0, 0.5)]
    assert stretch[1] / stretch[0] == pytest.approx(1 + 0.5 * 2 / 3 * 0.05, abs=0.004)


@pytest.mark.parametrize("power", [1.5, 2.0])
def test_what_gives_way_with_a_power_of_the_strain_is_softer_by_that_power(plane: FlatSolid, power: float) -> None:
    """Pulled along by a fiftieth of its length at the clamp, and by a twentieth; the strain falls evenly to none at the free end."""
    tip, longer = 2 * int(plane.nodes[:, 0].argmax()), []
    for strain in (0.02, 0.05):
        load = plane.weight(np.array([strain * SPECIFIC / LENGTH, 0.0]))
        stretch = [replace(plane, softens=share, power=power).balanced(SPECIFIC, load, still(plane))[tip] for share in (0.0, 0.5)]
        longer.append(stretch[1] / stretch[0] - 1)
    assert longer[0] == pytest.approx(0.5 * 0.1 * (0.02 / 0.1) ** power * 2 / (power + 2), rel=0.1)
    assert longer[1] / longer[0] == pytest.approx((0.05 / 0.02) ** power, rel=0.1)


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_what_gives_way_pulls_the_more_the_further_it_is_drawn(plane: FlatSolid, power: float) -> None:
    soft, tip = replace(plane, softens=2.0, power=power), 2 * int(plane.nodes[:, 0].argmax())
    drawn = [soft.balanced(SPECIFIC, plane.weight(np.array([pull * SPECIFIC / LENGTH, 0.0])), still(plane))[tip] for pull in (0.05, 0.1, 0.12)]
    assert (np.diff(drawn) > 0).all()


def test_drag_of_squared_speed_brakes_what_is_fast(plane: FlatSolid) -> None:
    """As in a vacuum without weight or stiffness: 1 / v grows by drag times time."""
    speed = np.zeros(2 * len(plane.nodes))
    speed[1::2] = 2.0
    loose = replace(plane, held=np.zeros(len(plane.nodes), bool))
    u = loose.march(SPECIFIC, still(plane), still(plane), speed, drag_per_s=0.0, drag_per_m=5.0, step_s=2e-3, steps=50)
    assert u[-1, 1::2] == pytest.approx(np.log(1 + 5.0 * 2.0 * 0.1) / 5.0, rel=5e-3)


def test_a_step_that_is_too_long_for_a_jolt_is_halved(plane: FlatSolid, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pose of a filmed strip has noise in its velocity, which the first steps meet."""
    jolt = still(plane)
    jolt[2 * int(plane.nodes.sum(1).argmax())] = -20.0  # one corner of the free end, m/s
    march = {"drag_per_s": 1.0, "step_s": 5e-4}
    fine = plane.march(SPECIFIC, still(plane), still(plane), jolt, drag_per_s=1.0, step_s=5e-4 / 32, steps=32 * 20)[::32]
    assert plane.march(SPECIFIC, still(plane), still(plane), jolt, **march, steps=20)[-1] == pytest.approx(fine[-1], abs=1e-3)
    monkeypatch.setattr("diffphys_ros.elements.plane.MOST_SPLITS", 0)
    with pytest.raises(DivergedError):
        plane.march(SPECIFIC, still(plane), still(plane), jolt, **march, steps=20)
