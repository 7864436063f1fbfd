"""Which footfalls are on which floor: level walks, ramps, stairs and kerbs, from strides alone and from samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import gtsam
import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.io import read
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.person import INSTEP
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk
from fg_nav.lab.simulation.routes import stairs
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.recording import Recording
from fg_nav.smoother import heights, smooth
from fg_nav.smoother.graph import solve
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.strides import place_nodes
from fg_nav.solution import Solution
from fg_nav.truth import Fix
from tests.real_data import DATA, needs_data
from tests.simulated import LEVER, PERSON, QUIET, simulated
from tests.smoother.walks import DEFAULT, FREE, demo, noise_free

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
    return heights.find_floors(*walked(legs, drift, seed=seed), SETTLING_M)[0]


SQUARE = tuple((12, k * np.pi / 2, 0.0) for k in range(4))


def test_a_level_walk_is_on_one_floor_whatever_its_strides_climb_in_excess() -> None:
    for drift, seed in product((-0.012, -0.004, 0.0, 0.008), range(3)):
        assert np.mean(floors_of(*SQUARE, drift=drift, seed=seed) == 0) > 0.8, (drift, seed)


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


def test_storeys_are_recognized_by_the_stairs_between_them() -> None:
    here, there, up, down = (40, 0.0, 0.0), (40, np.pi, 0.0), (9, 0.0, RISE), (9, np.pi, -RISE)
    for drift in (-0.005, 0.008):
        floor = floors_of(here, up, here, there, down, there, here, up, here, up, here, drift=drift)
        visits = ((5, 35, 0), (55, 125, 1), (145, 210, 0), (230, 260, 1), (280, 310, 2), (42, 48, -1))
        assert all((floor[first:last] == number).all() for first, last, number in visits)


def test_a_floor_is_recognized_by_its_height_after_slopes() -> None:
    slopes = [(25, k * 1.5, 0.05 * (-1) ** k) for k in range(6)]
    for higher_m, number in ((0.0, 0), (0.6, 1), (-0.6, 1)):
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
    assert (heights.find_floors(t[footfall], position[piece], SETTLING_M)[0] == 0).all()
    assert (heights.find_floors_of_pieces(t, footfall, position[piece], stepped, SETTLING_M)[0] == 0).all()


@pytest.mark.parametrize("riser", [0.15, 0.175])
def test_stairs_show_their_riser_and_what_strides_climb_in_excess(riser: float) -> None:
    """Up and down, with landings of two strides and single risers, and no level floor at all."""
    up = np.array([2, 2, 2, 1, 0, 0, 2, 2, 2, 2, 1]) * riser
    down = -np.array([2, 2, 2, 2, 0, 0, 1, 2, 2, 2, 1]) * riser
    for excess in (-0.03, 0.0, 0.012, 0.03):
        step = np.diff(walked(((11, 0.0, up), (11, np.pi, down)), excess)[1], axis=0)
        ground = heights.judge_ground(step, 0.015)
        assert heights.find_riser(step[:, 2], np.ones(len(step)), 0.015)[0] == pytest.approx(riser, abs=0.006)
        assert ground.drift == pytest.approx(excess, abs=3.0 * ground.drift_sigma)
        assert ground.drift_sigma < 0.004


def test_long_strides_climb_more_in_excess_than_short_ones() -> None:
    for noise_m, excess in product((0.005, 0.02), (-0.06, 0.06)):
        rng = np.random.default_rng(0)
        length = rng.uniform(0.3, 1.7, 80)
        climb = 0.17 * rng.integers(-2, 3, 80) + excess * length + noise_m * rng.standard_normal(80)
        riser, noise = heights.find_riser(climb, length, 0.03)
        assert riser == pytest.approx(0.17, abs=0.003)
        assert noise == pytest.approx(1.5 * noise_m, rel=0.2)
        level = 0.5 * excess * length + 0.005 * rng.standard_normal(80)
        ground = heights.judge_ground(np.stack([STRIDE_M * length, 0.0 * length, level], axis=1), 0.03)
        assert ground.drift == pytest.approx(0.5 * excess * np.median(length), abs=0.004)
        assert np.median(ground.level) > 0.9


def test_drift_and_noise_are_those_of_the_walk() -> None:
    """Their error over the sigma that is reported, and the noise beside a ramp and stairs that do not count."""
    z = []
    for seed in range(30):
        drift = 0.005 * np.random.default_rng(100 + seed).standard_normal()
        _, position = walked(SQUARE, drift, seed=seed)
        ground = heights.judge_ground(np.diff(position, axis=0), 0.005)
        z.append((ground.drift - drift) / ground.drift_sigma)
    assert abs(np.mean(z)) < 0.6
    assert 0.4 < np.std(z) < 1.5
    legs = (*SQUARE, (30, 0.0, 0.07), (9, 0.0, 0.34), *SQUARE)
    assert heights.estimate_noise(np.diff(walked(legs, noise=0.015)[1][:, 2])) == pytest.approx(0.02, abs=0.008)
    assert np.diff(heights.DRIFTS_M).max() < 0.25 * 0.005


def walk_course(course: Sequence[Section], p: SmootherParameters = DEFAULT) -> tuple[Solution, Floats, Floats]:
    """A walk of the usual person, the error of its heights and their sigmas (F,) m at the footfalls."""
    recording = simulated(course, PERSON, INSTEP, seed=1).recording
    found = smooth(recording, detect_stances(recording), p)
    return found, *height_errors(recording, found)


def height_errors(recording: Recording, solution: Solution) -> tuple[Floats, Floats]:
    """Errors (F,) m of the heights at the footfalls, and their sigmas."""
    truth, table = recording.truth.position[:, 2], solution.stances
    error = table.position[:, 2] - (truth[table.sample] - truth[table.sample[0]])
    return error, np.sqrt(table.position_cov[:, 2, 2])


def test_a_ramp_stays_a_ramp_and_stairs_stay_stairs_and_the_floors_are_found_again() -> None:
    """Corridors at the ends of a ramp show what strides climb in excess."""
    way = polyline([(0, 0, 0), (0, 20, 0), (0, 40, 1.0), (0, 60, 1.0)], 1.0)
    ramp_and_back = [Stand(3.0), Walk(way), TurnOnSpot(np.pi), Walk(way.reverse()), Stand(3.0)]
    for course, climb, floors in ((ramp_and_back, 1.0, "2 level"), (stairs(), 20 * Stairs(1).rise_m, "3 level")):
        found, error, sigma = walk_course(course)
        assert np.ptp(found.stances.position[:, 2]) == pytest.approx(
            climb, abs=0.05 if course is not ramp_and_back else 0.1
        )
        assert np.abs(error).max() < 0.05
        assert np.mean(np.abs(error[1:]) < 1.96 * sigma[1:]) > 0.88
        assert any(f"{floors} floors" in note for note in found.notes)
        if course is ramp_and_back:
            assert np.abs(error).max() < 0.2 * np.abs(walk_course(course, FREE)[1]).max()


def test_a_path_that_climbs_over_level_floors_has_a_softer_sole_than_expected() -> None:
    """By as much as the sole gives way, and not by what is left where it is known."""
    walk, excess_m = noise_free(), []
    for settling_m in (0.0, QUIET.walk.sole_m):
        p = replace(DEFAULT, known_lever=LEVER, settling_m=settling_m)
        problem = walk_problem(walk.recording, walk.stances, 0.0, p)
        values = gtsam.Values(solve(problem).values)
        (prior,) = list(heights.add_constraints(problem, values).blocks[-1].factors())
        (key,) = prior.keys()
        found = -prior.linearize(values).jacobian()[1] / prior.linearize(values).jacobian()[0][0]
        excess_m.append(float(values.atVector(key)[0] - found[0]))
    assert excess_m[0] == pytest.approx(QUIET.walk.sole_m, rel=0.5)
    assert abs(excess_m[1]) < 0.4 * excess_m[0]


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


# --- the barometer


GROUND_PA = 97_970.0


@cache
def climbed() -> Recording:
    """Two flights up and down again, a minute and a half."""
    return simulated(stairs(), PERSON, INSTEP, seed=1).recording


def with_barometer(
    recording: Recording,
    seed: int = 0,
    every: int = 8,
    white_pa: float = 2.0,
    drift_pa: float = 0.3,
    quantum_pa: float = 1.0,
    scale: float = 0.0,
) -> Recording:
    """A reading every few samples: white noise and a random walk in Pa, rounded, in air of another temperature."""
    rng, t = np.random.default_rng(seed), recording.t
    height = recording.truth.position[:, 2] - recording.truth.position[0, 2]
    drift = np.cumsum(rng.normal(0.0, drift_pa * np.sqrt(np.diff(t, prepend=t[0]))))
    read_pa = GROUND_PA * np.exp(-height / (heights.SCALE_HEIGHT_M * (1.0 + scale))) + drift
    read_pa = quantum_pa * np.rint((read_pa + rng.normal(0.0, white_pa, len(t))) / quantum_pa)
    return replace(recording, pressure=np.where(np.arange(len(t)) % every == 0, read_pa, np.nan))


def smoothed(recording: Recording) -> Solution:
    """By strides and pressure, without level floors."""
    return smooth(recording, detect_stances(recording), FREE)


def test_heights_are_better_with_a_barometer_and_their_sigma_honest() -> None:
    recording = climbed()
    plain, _ = height_errors(recording, smoothed(recording))
    walks = [with_barometer(recording, seed) for seed in range(4)]
    found = [height_errors(one, smoothed(one)) for one in walks]
    assert np.median([np.abs(error).max() for error, _ in found]) < 0.7 * np.abs(plain).max()
    ends = np.array([error[-1] / sigma[-1] for error, sigma in found])
    assert np.sqrt((ends**2).mean()) < 1.5
    assert all(np.mean(np.abs(error[1:]) < 2.0 * sigma[1:]) > 0.9 for error, sigma in found)


def test_stairs_in_air_of_another_temperature_close_and_have_it_in_their_sigma() -> None:
    for scale in (-heights.SCALE_SIGMA, heights.SCALE_SIGMA):
        recording = with_barometer(climbed(), scale=scale)
        found = smoothed(recording)
        error, sigma = height_errors(recording, found)
        top = np.argmax(recording.truth.position[found.stances.sample, 2])
        assert (np.abs(error[[-1, top]]) < 2.0 * sigma[[-1, top]]).all()
        of_scale = heights.SCALE_SIGMA * np.ptp(recording.truth.position[:, 2])
        assert of_scale < sigma[top] < 1.3 * np.hypot(of_scale, sigma[-1])


def test_a_door_and_gusts_move_the_heights_by_less_than_their_sigma() -> None:
    recording = with_barometer(climbed())
    calm, sigma = height_errors(recording, smoothed(recording))
    gust = recording.pressure + np.where((recording.t % 20.0) < 0.7, 40.0, 0.0)
    gusty, _ = height_errors(recording, smoothed(replace(recording, pressure=gust)))
    assert np.abs(gusty - calm).max() < 1.5 * sigma.max()
    door = recording.pressure + np.where(recording.t > 0.5 * recording.t[-1], 25.0, 0.0)  # 2.1 m
    error, sigma = height_errors(recording, smoothed(replace(recording, pressure=door)))
    assert np.abs(error).max() < 2.1
    assert np.abs(error[-1]) < 3.0 * sigma[-1]


@pytest.mark.parametrize(("white_pa", "quantum_pa"), [(0.0, 0.01), (4.0, 1.0), (1.0, 100.0)])
def test_noise_is_that_of_the_recording(white_pa: float, quantum_pa: float) -> None:
    recording = with_barometer(climbed(), every=2, white_pa=white_pa, quantum_pa=quantum_pa, drift_pa=0.0)
    stances = detect_stances(recording)
    nodes = place_nodes(recording, stances, FREE)
    seen = heights.average_pressures(recording, stances, nodes)
    barometer = heights.calibrate_barometer(recording, seen)
    truth = GROUND_PA * np.exp(
        -(recording.truth.position[:, 2] - recording.truth.position[0, 2]) / heights.SCALE_HEIGHT_M
    )
    error = seen.mean - truth[nodes.sample[nodes.result]]
    sigma = barometer.sigma_m(seen.number) / barometer.m_per_pa
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    assert sigma.max() < 3.0 if quantum_pa < 100.0 else sigma.min() > 0.25 * quantum_pa


def test_online_has_the_heights_of_the_batch() -> None:
    recording = with_barometer(climbed())
    recording = recording.slice(0, len(recording) // 2)
    navigator, rows = OnlineNavigator(OnlineOptions(parameters=FREE)), rows_of(recording)
    for start in range(0, len(rows), 500):
        part = rows[start : start + 500]
        navigator.push(part[:, 0], part[:, 1:4], part[:, 4:7], None, part[:, 10])
    navigator.close()
    found, batch = navigator.finish(), smoothed(recording)
    moment = np.interp(batch.stances.t, found.moment.t, found.moment.position[:, 2])
    assert np.abs(moment - batch.stances.position[:, 2]).max() < 0.6
    error, sigma = height_errors(recording, found)
    assert np.mean(np.abs(error[1:]) < 2.0 * sigma[1:]) > 0.9
    at_end = np.interp(batch.stances.t, found.stances.t, found.stances.position[:, 2])
    assert np.abs(at_end - batch.stances.position[:, 2]).max() < 0.1
    assert found.graph["barometer"] > 20


def real(name: str) -> Recording:
    assert DATA is not None
    return replace(read(DATA / f"{name}.csv.gz", barometer=DATA / f"{name}.baro.csv.gz"), mag=None)


@needs_data
def test_a_real_staircase_is_as_high_down_as_up_and_rounds_of_one_floor_end_at_their_height() -> None:
    """The barometer alone has 7.7 m up and 7.6 m down."""
    ends = [real(f"mtig710/2022_1_14_stair_walk_{way}_foot1") for way in ("up", "down")]
    up, down = (smoothed(one).stances.position[-1, 2] for one in ends)
    assert 7.4 < up < 8.3
    assert abs(up + down) < 0.3
    for name in ("square_70m_1", "square_70m_3", "rectangle_1"):
        table = smoothed(real(f"mems_foot/{name}")).stances
        assert abs(table.position[-1, 2]) < min(0.5, 2.0 * np.sqrt(table.position_cov[-1, 2, 2])), name
