"""The line integral of the field: magnetostatics under a walking foot, and what it shows of heading."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec

from fg_nav.factors.magnetic_field import EAST, IRON, NORTH, PHI, SIZE, FieldPotential, integrate_field
from fg_nav.factors.rotation import rotation_exp
from fg_nav.lab.simulation.fields import Circuit, Cylinders, Sum, draw_floor, magnet, make_earth_field

MU_0 = 0.4 * np.pi  # uT m / A.

EARTH = make_earth_field(48.0, 64.0, 12.0)
HARD_IRON = np.array([3.0, -2.0, 9.0])
STRIDE_M, STRIDE_S, SWING_S = 1.4, 1.1, 0.45
MAGNET = magnet(np.array([3.0, 0.7, 0.1]), np.array([20.0, -30.0, 40.0]))

FIELDS = {
    "earth": EARTH,
    "floor": Sum((EARTH, draw_floor(np.random.default_rng(3)))),
    "magnet": Sum((EARTH, MAGNET)),
    "cylinder": Cylinders(np.array([[2.5, 0.8]]), np.array([0.3]), EARTH),
    "cable": Sum((EARTH, Circuit(np.array([[-5.0, 1, 0.5], [9, 1, 0.5], [9, 3, 2.5], [-5, 3, 2.5]]), 8.0))),
}


def footfalls(strides):
    return STRIDE_S * np.arange(strides + 1) + 0.3


def walking(t, courses):
    """Attitudes and positions of a sensor on a foot that makes a stride on each course (rad, from east to north)."""
    courses = np.asarray(courses, dtype=float)
    k = np.clip((t // STRIDE_S).astype(int), 0, len(courses) - 1)
    share = np.clip((t - k * STRIDE_S - 0.6) / SWING_S, 0.0, 1.0)
    forward = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    direction = np.stack([np.cos(courses), np.sin(courses)], axis=1)
    starts = STRIDE_M * np.vstack([np.zeros(2), np.cumsum(direction, axis=0)])[: len(courses)]
    over_ground = starts[k] + STRIDE_M * forward[:, None] * direction[k]
    position = np.column_stack([over_ground, 0.09 + 0.12 * np.sin(np.pi * share) ** 2])
    before = np.concatenate((courses[:1], courses[:-1]))[k]
    yaw = before + forward * (courses[k] - before)
    pitch = -0.9 * np.sin(2.0 * np.pi * share) * np.sin(np.pi * share)
    return rotation_exp(yaw[:, None] * np.array([0.0, 0.0, 1.0])) @ rotation_exp(
        pitch[:, None] * np.array([0.0, 1.0, 0.0]) + 0.1
    ), position


def recorded(field, courses, rate=100.0, iron=HARD_IRON):
    t = np.arange(0.0, STRIDE_S * len(courses) + 0.5, 1.0 / rate)
    R, p = walking(t, courses)
    return t, R, p, np.einsum("nba,nb->na", R, field.at(p)) + iron


def straight_integral(field, a, b):
    along = lambda x: field.at((a + x * (b - a))[None])[0] @ (b - a)  # noqa: E731
    return quad_vec(along, 0.0, 1.0, epsabs=1e-7)[0]


def integrals(walk, strides):
    """What `integrate_field` makes of each stride: u and s."""
    found = integrate_field(*walk, footfalls(strides))
    return np.diff(found.u), np.diff(found.s, axis=0)


def residual_of(nav_R_body, displacement, earth, iron, potentials, u, s):
    pose = np.zeros((len(u), 4, 4))
    pose[:, :3, :3] = nav_R_body
    states = np.zeros((2, len(u), SIZE))
    states[..., PHI], states[..., EAST : NORTH + 1], states[..., IRON] = potentials.T, earth, iron
    stride = FieldPotential(u, s, np.zeros((len(u), 3)), displacement, nav_R_body, np.ones(len(u)))
    return stride.evaluate([pose, *states], False)[0][:, 0]


@pytest.mark.parametrize("name", FIELDS)
def test_a_foot_in_the_air_sums_the_field_of_the_straight_line(name):
    """Without curl every path has the same integral; what is left is second order in the period."""
    courses = np.array([0.0, 0.1, 0.1, -0.2])
    ends = walking(footfalls(4), courses)[1]
    straight = np.array([straight_integral(FIELDS[name], a, b) for a, b in pairwise(ends)])
    left = []
    for rate in (50.0, 100.0, 200.0):
        u, s = integrals(recorded(FIELDS[name], courses, rate), 4)
        left.append(np.sqrt(np.mean((u - s @ HARD_IRON - straight) ** 2)))
    assert left[1] < 0.02
    assert left[2] < 1e-3 or left[2] < 0.5 * left[0] / 4.0


def test_between_its_ends_lie_the_earth_and_a_difference_of_potentials():
    """With B = E - grad phi, the potential of a magnet being SCALE m.r / r^3, the residual is zero."""
    t, R, p, y = recorded(FIELDS["magnet"], np.zeros(4), 400.0)
    found = integrate_field(t, R, p, y, footfalls(4), vertical_uT=float(EARTH.vector[2]))
    nav_R_body, ends = walking(footfalls(4), np.zeros(4))
    r = ends - MAGNET.position
    phi = 0.1 * (r @ MAGNET.moment[0]) / np.linalg.norm(r, axis=1) ** 3  # mu_0 / 4 pi is 0.1 uT m / A
    d = np.einsum("kba,kb->ka", nav_R_body[:-1], np.diff(ends, axis=0))
    pairs = np.stack([phi[:-1], phi[1:]], axis=1)
    stride = nav_R_body[:-1], d, EARTH.vector[:2], HARD_IRON
    e = residual_of(*stride, pairs, np.diff(found.u), np.diff(found.s, axis=0))
    assert np.abs(np.diff(phi)).max() > 1.0
    np.testing.assert_allclose(e, 0.0, atol=5e-3)
    other_sign = residual_of(*stride, -pairs, np.diff(found.u), np.diff(found.s, axis=0))
    assert np.abs(other_sign).max() > 2.0


def test_a_loop_sums_to_nothing_unless_a_current_passes_through_it():
    square = np.repeat([0.0, np.pi / 2, np.pi, -np.pi / 2], 3)
    assert np.linalg.norm(np.diff(walking(footfalls(12), square)[1][[0, -1]], axis=0)) < 1e-9
    floor = FIELDS["floor"]
    through = np.array([[2.1, 2.1, -20.0], [2.1, 2.1, 20.0], [30.0, 2.1, 20.0], [30.0, 2.1, -20.0]])
    for current in (0.0, 5.0, -5.0):
        walk = recorded(Sum((floor, Circuit(through, current))), square)
        u, s = integrals(walk, 12)
        assert (u - s @ HARD_IRON).sum() == pytest.approx(MU_0 * current, abs=0.1)
    beside = through + np.array([4.0, 0.0, 0.0])
    u, s = integrals(recorded(Sum((floor, Circuit(beside, 5.0))), square), 12)
    assert (u - s @ HARD_IRON).sum() == pytest.approx(0.0, abs=0.1)


def test_no_field_at_all_is_refused():
    t, R, p, y = recorded(EARTH, [0.0])
    with pytest.raises(ValueError, match="no field"):
        integrate_field(t, R, p, np.full_like(y, np.nan), footfalls(1))
