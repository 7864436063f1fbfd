"""Which footfalls are on which floor: level walks, ramps, stairs and kerbs, from strides alone and from samples."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.person import INSTEP
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk
from fg_nav.lab.simulation.routes import stairs
from fg_nav.smoother import smooth
from fg_nav.smoother.heights import (
    DRIFTS_M,
    estimate_noise,
    find_floors,
    find_floors_of_pieces,
    find_riser,
    judge_ground,
)
from fg_nav.smoother.parameters import WalkParameters
from fg_nav.solution import Solution
from fg_nav.truth import Fix
from tests.simulated import PERSON, simulated
from tests.smoother.walks import DEFAULT, demo

STRIDE_M = 1.3
SETTLING_M = DEFAULT.settling_sigma_m


def walked(legs: Sequence[tuple[int, float, Floats | float]], drift: float = 0.0, noise: float = 0.006, seed: int = 0):
    """Times (F,) s and places (F, 3) m of footfalls, after legs: number of strides, course rad, climb of a stride m."""
    course = np.concatenate([np.full(n, a) for n, a, _ in legs])
    climb = np.concatenate([np.broadcast_to(rise, n) for n, _, rise in legs])
    seen = climb + drift + noise * np.random.default_rng(seed).standard_normal(len(climb))
    step = np.stack([STRIDE_M * np.cos(course), STRIDE_M * np.sin(course), seen], axis=1)
    position = np.vstack([np.zeros(3), np.cumsum(step, axis=0)])
    return 1.1 * np.arange(len(position)), position


def floors_of(*legs: tuple[int, float, Floats | float], drift: float = 0.0, seed: int = 0):
    return find_floors(*walked(legs, drift, seed=seed), SETTLING_M)[0]


SQUARE = tuple((12, k * np.pi / 2, 0.0) for k in range(4))


@pytest.mark.parametrize("drift", [-0.012, -0.004, 0.0, 0.008])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_level_walk_is_on_one_floor_whatever_its_strides_climb_in_excess(drift: float, seed: int) -> None:
    assert np.mean(floors_of(*SQUARE, drift=drift, seed=seed) == 0) > 0.8


@pytest.mark.parametrize("slope", [0.01, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("drift", [-0.004, 0.008])
def test_a_ramp_is_no_floor_and_the_floors_at_its_ends_are_two(slope: float, drift: float) -> None:
    up, down = (30, 0.0, slope * STRIDE_M), (30, np.pi, -slope * STRIDE_M)
    floor = floors_of((25, 0.0, 0.0), up, (25, 0.0, 0.0), (25, np.pi, 0.0), down, (25, np.pi, 0.0), drift=drift)
    assert (floor[5:20] == 0).all()
    assert (floor[60:100] == 1).all()
    assert (floor[-20:] == 0).all() if slope > 0.01 else (floor[-20:] != 1).all()
    assert (floor[30:50] == -1).all()
    assert (floor[110:130] == -1).all()


RISE = np.full(9, 0.34)


@pytest.mark.parametrize("drift", [-0.005, 0.008])
def test_storeys_are_recognized_by_the_stairs_between_them(drift: float) -> None:
    here, there, up, down = (40, 0.0, 0.0), (40, np.pi, 0.0), (9, 0.0, RISE), (9, np.pi, -RISE)
    floor = floors_of(here, up, here, there, down, there, here, up, here, up, here, drift=drift)
    visits = [(5, 35, 0), (55, 125, 1), (145, 210, 0), (230, 260, 1), (280, 310, 2)]
    for first, last, number in visits:
        assert (floor[first:last] == number).all()
    assert (floor[42:48] == -1).all()


@pytest.mark.parametrize(("higher_m", "number"), [(0.0, 0), (0.6, 1), (-0.6, 1)])
def test_a_floor_is_recognized_by_its_height_after_slopes(higher_m: float, number: int) -> None:
    slopes = [(25, k * 1.5, 0.05 * (-1) ** k) for k in range(6)]
    floor = floors_of((60, 0.0, 0.0), *slopes, (2, 0.0, higher_m / 2), (60, np.pi, 0.0))
    assert (floor[5:50] == 0).all()
    assert (floor[65:205] == -1).all()
    assert (floor[-50:] == number).all()


def test_pieces_of_a_standing_are_no_strides_and_do_not_hide_a_floor() -> None:
    """A standing online is told in pieces, all on one spot: they show none of what strides climb in excess."""
    t, position = walked(SQUARE, drift=-0.012)
    piece = np.repeat(np.arange(len(t)), np.where(np.arange(len(t)) == len(t) - 1, 5, 1))
    stepped = np.append(True, np.diff(piece) > 0)
    t, footfall = 0.01 * np.arange(110 * len(piece)), 110 * np.arange(len(piece))
    assert (find_floors(t[footfall], position[piece], SETTLING_M)[0] == 0).all()
    assert (find_floors_of_pieces(t, footfall, position[piece], stepped, SETTLING_M)[0] == 0).all()


@pytest.mark.parametrize("excess", [-0.03, 0.0, 0.012, 0.03])
@pytest.mark.parametrize("riser", [0.15, 0.175])
def test_stairs_show_their_riser_and_what_strides_climb_in_excess(excess: float, riser: float) -> None:
    """Up and down, with landings of two strides and single risers, and no level floor at all."""
    up, down = np.array([2, 2, 2, 1, 0, 0, 2, 2, 2, 2, 1]) * riser, -np.array([2, 2, 2, 2, 0, 0, 1, 2, 2, 2, 1]) * riser
    _, position = walked(((11, 0.0, up), (11, np.pi, down)), excess)
    step = np.diff(position, axis=0)
    ground = judge_ground(step, 0.015)
    assert find_riser(step[:, 2], np.ones(len(step)), 0.015)[0] == pytest.approx(riser, abs=0.006)
    assert ground.drift == pytest.approx(excess, abs=3.0 * ground.drift_sigma)
    assert ground.drift_sigma < 0.004


def test_drift_and_noise_are_those_of_the_walk() -> None:
    """Their error over the sigma that is reported, and the noise beside a ramp and stairs that do not count."""
    z = []
    for seed in range(30):
        drift = 0.005 * np.random.default_rng(100 + seed).standard_normal()
        _, position = walked(SQUARE, drift, seed=seed)
        ground = judge_ground(np.diff(position, axis=0), 0.005)
        z.append((ground.drift - drift) / ground.drift_sigma)
    assert abs(np.mean(z)) < 0.6
    assert 0.4 < np.std(z) < 1.5
    legs = (*SQUARE, (30, 0.0, 0.07), (9, 0.0, 0.34), *SQUARE)
    assert estimate_noise(np.diff(walked(legs, noise=0.015)[1][:, 2])) == pytest.approx(0.02, abs=0.008)
    assert np.diff(DRIFTS_M).max() < 0.25 * 0.005


def smoothed(course: Sequence[Section], floors: bool = True) -> tuple[Solution, Floats, Floats]:
    """A walk of the usual person, the error of its heights and their sigmas (F,) m at the footfalls."""
    recording = simulated(course, PERSON, INSTEP, seed=1).recording
    p = replace(DEFAULT, walk=WalkParameters(floors=floors))
    found = smooth(recording, detect_stances(recording), p)
    height = recording.truth.position[found.stances.sample, 2]
    error = found.stances.position[:, 2] - (height - height[0])
    return found, error, np.sqrt(found.stances.position_cov[:, 2, 2])


def ramp_and_back(slope: float) -> list[Section]:
    """Along a corridor of 60 m with a ramp in the middle, and back."""
    top = 20.0 * slope
    way = polyline([(0, 0, 0), (0, 20, 0), (0, 40, top), (0, 60, top)], 1.0)
    return [Stand(3.0), Walk(way), TurnOnSpot(np.pi), Walk(way.reverse()), Stand(3.0)]


def test_a_ramp_stays_a_ramp_and_the_corridors_at_its_ends_tell_what_strides_climb_in_excess() -> None:
    found, error, sigma = smoothed(ramp_and_back(0.05))
    assert np.ptp(found.stances.position[:, 2]) == pytest.approx(1.0, rel=0.1)
    assert np.abs(error).max() < 0.05
    assert np.mean(np.abs(error[1:]) < 1.96 * sigma[1:]) > 0.88
    _, free, _ = smoothed(ramp_and_back(0.05), floors=False)
    assert np.abs(error).max() < 0.2 * np.abs(free).max()


def test_stairs_stay_stairs_and_the_floors_are_found_again() -> None:
    found, error, sigma = smoothed(stairs())
    assert np.ptp(found.stances.position[:, 2]) == pytest.approx(20 * Stairs(1).rise_m, abs=0.05)
    assert np.abs(error).max() < 0.05
    assert np.mean(np.abs(error[1:]) < 1.96 * sigma[1:]) > 0.88
    assert any("3 level floors" in note for note in found.notes)


@pytest.mark.parametrize("sigma_m", [0.05, 5.0])
def test_floors_and_fixes_agree_on_the_height(sigma_m: float) -> None:
    """A surveyed height does not bend the floor it is on, nor does a receiver's that is off by metres."""
    walk, off_m = demo(), 0.4 * sigma_m
    truth, t = walk.recording.truth, walk.recording.t
    at = [int(walk.stances.stillest(walk.recording.gyr)[k]) for k in (20, 40)]
    fixes = [Fix(float(t[i]), truth.position[i] - truth.position[0] + [0.0, 0.0, off_m], 1.0, sigma_m) for i in at]
    found = smooth(walk.recording, walk.stances, DEFAULT, fixes=fixes)
    assert any("1 level floor" in note for note in found.notes)
    assert np.ptp(found.stances.position[:, 2]) < 0.03
    assert np.abs(found.stances.position[:, 2]).max() < 0.05
