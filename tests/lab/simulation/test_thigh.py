"""The motion of the thigh against mechanics: derivatives, exact integration, rest, and a real thigh."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import polyline, straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Stairs, Stand, TurnOnSpot, Walk, plan
from fg_nav.lab.simulation.thigh import Pocket, build_thigh_motion

UP = np.array([0.0, 0.0, 1.0])
STILL = Pocket(tilt_rad=0.0, posture_rad=0.0)
QUIET = replace(STILL, ringing=0.0)


def walk(*sections, pocket=Pocket(), seed=0):
    rng = np.random.default_rng(seed)
    strides = plan(sections, Person(), rng)
    return strides, build_thigh_motion(strides, pocket, rng)


@pytest.fixture(scope="module")
def varied():
    """Walking round a corner, running, standing, turning and stairs."""
    corner = polyline([(0, 0), (0, 15), (15, 15)], 1.2)
    run = straight(20.0).place(corner.end)
    sections = [Stand(3.0), Walk(corner), Walk(run, Style.RUN), Stand(3.0), TurnOnSpot(np.pi), Stairs(8), Stand(3.0)]
    return walk(*sections)


@pytest.fixture(scope="module")
def straight_on():
    """A walk to the north with the sensor's axes along the thigh's."""
    return walk(Stand(3.0), Walk(straight(100.0)), Stand(3.0), pocket=STILL)


def instants(strides, count=4000, seed=1):
    return np.sort(np.random.default_rng(seed).uniform(0.0, strides.end_s, count))


def walking(strides, rate_hz=100.0):
    """Instants of steady walking, whole strides."""
    return np.arange(strides.start[3], strides.start[-3], 1 / rate_hz)


def test_the_state_is_that_of_a_rigid_body_and_samples_are_means(varied):
    strides, motion = varied
    t, half = instants(strides), 1e-4
    before, state, after = (motion.at(t + h) for h in (-half, 0.0, half))
    np.testing.assert_allclose((after.position - before.position) / (2 * half), state.velocity, atol=1e-4)
    felt = np.einsum(
        "nji,nj->ni", state.nav_R_body, (after.velocity - before.velocity) / (2 * half) + GRAVITY_M_S2 * UP
    )
    np.testing.assert_allclose(felt, state.force, atol=0.02)
    turned = np.swapaxes(before.nav_R_body, 1, 2) @ after.nav_R_body
    np.testing.assert_allclose(Rotation.from_matrix(turned).as_rotvec() / (2 * half), state.rate, atol=2e-3)
    t, period_s = instants(strides, 500), 0.01
    state = motion.at((t[:, None] + period_s * (np.arange(50) + 0.5) / 50).ravel())
    rate, force = motion.sampled(t, period_s)
    np.testing.assert_allclose(rate, state.rate.reshape(-1, 50, 3).mean(axis=1), atol=2e-4)
    np.testing.assert_allclose(force, state.force.reshape(-1, 50, 3).mean(axis=1), atol=0.01)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_one_who_stands_only_sways():
    _, motion = walk(Stand(20.0), Walk(straight(5.0)), Stand(5.0))
    state = motion.at(np.arange(0.5, 19.5, 0.01))
    assert 0.02 < np.degrees(rms(np.linalg.norm(state.rate, axis=1))) < 1.0
    assert np.ptp(state.position, axis=0).max() < 0.01
    np.testing.assert_allclose(np.linalg.norm(state.force, axis=1), GRAVITY_M_S2, atol=0.1)


def test_without_sway_standing_is_perfect_rest(straight_on):
    strides, motion = straight_on
    end = strides.start[-1] + strides.duration[-1]
    for t in (np.arange(0.0, strides.start[0] - 0.1, 0.01), np.arange(end + 0.1, strides.end_s, 0.01)):
        state = motion.at(t)
        np.testing.assert_allclose(state.rate, 0.0, atol=1e-9)
        np.testing.assert_allclose(state.velocity, 0.0, atol=1e-9)
        np.testing.assert_allclose(state.force, np.tile(GRAVITY_M_S2 * UP, (len(t), 1)), atol=1e-9)


def test_the_thigh_stays_above_the_foot_it_belongs_to(varied):
    strides, motion = varied
    t = strides.start + 0.87 * strides.duration
    hip = motion.hip(t)
    away = np.linalg.norm((hip - strides.footprint[1:])[:, :2], axis=1)
    assert away.max() < 0.12
    height = hip[:, 2] - strides.footprint[1:, 2]
    assert ((height > 0.78) & (height < 0.93)).all()


def test_the_body_faces_where_the_foot_points(varied):
    strides, motion = varied
    t = np.array([2.0, strides.end_s - 1.0])
    facing = compute_heading(motion.at(t).nav_R_body @ motion.thigh_R_body.T)
    meant = strides.heading[[0, -1]]
    assert np.degrees(np.abs(np.angle(np.exp(1j * (facing - meant))))).max() < 1.0


def spectrum_at(values, strides, per_stride):
    """Amplitude of what comes so many times in a mean stride, of evenly spaced values in `walking`."""
    t = walking(strides)
    phase = np.interp(t, strides.start, np.arange(len(strides)))
    return 2 * np.abs(np.mean((values - values.mean()) * np.exp(-2j * np.pi * per_stride * phase)))


def test_the_leg_swings_once_a_stride_and_the_body_bounces_twice():
    strides, motion = walk(Stand(3.0), Walk(straight(100.0)), Stand(3.0), pocket=QUIET)
    t = walking(strides)
    pitch, height = np.degrees(motion.angles(t)[:, 1]), motion.hip(t)[:, 2]
    assert spectrum_at(pitch, strides, 1) == pytest.approx(25.0, rel=0.05)
    assert spectrum_at(pitch, strides, 2) < 0.3 * spectrum_at(pitch, strides, 1)
    assert 2 * spectrum_at(height, strides, 2) == pytest.approx(0.045, rel=0.1)
    assert spectrum_at(height, strides, 1) < 0.1 * spectrum_at(height, strides, 2)


def test_the_leg_is_forward_in_late_swing_and_back_at_heel_off(straight_on):
    strides, motion = straight_on
    forward = -motion.angles(strides.start[3:-3] + 0.5 * strides.duration[3:-3])[:, 1]
    back = -motion.angles(strides.start[3:-3] + 0.1 * strides.duration[3:-3])[:, 1]
    assert np.degrees(forward).min() > 20
    assert np.degrees(back).max() < -10
    ahead = motion.at(strides.start[5:-5] + 0.5 * strides.duration[5:-5])
    hip = motion.hip(strides.start[5:-5] + 0.5 * strides.duration[5:-5])
    assert (ahead.position[:, 1] > hip[:, 1]).all()  # the walk goes north


def test_larger_strides_swing_more():
    swings = []
    for pace in (0.6, 1.0, 1.5):
        strides, motion = walk(Stand(3.0), Walk(straight(60.0), pace=pace), Stand(3.0), pocket=QUIET)
        swings.append(spectrum_at(motion.angles(walking(strides))[:, 1], strides, 1))
    assert swings[0] < 0.9 * swings[1] < 0.8 * swings[2]


def test_the_sensor_is_tilted_once_for_all():
    tilts = []
    for seed in range(60):
        _, motion = walk(Stand(1.0), Walk(straight(5.0)), Stand(1.0), seed=seed)
        tilts.append(Rotation.from_matrix(motion.thigh_R_body).as_rotvec())
    assert np.std(tilts) == pytest.approx(Pocket().tilt_rad, rel=0.25)
    np.testing.assert_allclose(np.mean(tilts, axis=0), 0.0, atol=0.1)


def test_a_tilt_turns_what_is_felt_and_nothing_else():
    quiet = walk(Stand(1.0), Walk(straight(9.0)), Stand(1.0), pocket=QUIET)[1]
    tilted = walk(Stand(1.0), Walk(straight(9.0)), Stand(1.0), pocket=replace(QUIET, tilt_rad=0.3))[1]
    t = np.arange(0.0, 8.0, 0.01)
    one, other = quiet.at(t), tilted.at(t)
    np.testing.assert_allclose(one.position, other.position, atol=1e-12)
    np.testing.assert_allclose(one.rate, other.rate @ tilted.thigh_R_body.T, atol=1e-12)
    np.testing.assert_allclose(one.force, other.force @ tilted.thigh_R_body.T, atol=1e-12)


def test_one_stride_is_enough_and_an_impossible_pocket_is_refused():
    _, motion = walk(Stairs(1), Stand(1.0))
    assert np.isfinite(motion.at(np.arange(0.0, 2.0, 0.01)).force).all()
    for wrong in ({"tilt_rad": np.nan}, {"posture_rad": -1.0}, {"ringing": -1.0}):
        with pytest.raises(SimulationError, match=next(iter(wrong))):
            Pocket(**wrong)
