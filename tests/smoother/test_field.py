"""A walk and its magnetic field together: a minute round a corridor in fields that are known."""

import math
import re
from collections import Counter
from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V
from scipy.signal import lfilter

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.estimators import choose_parameters
from fg_nav.factors.differential_field import BiasInformation
from fg_nav.frames import compute_heading, wrap_angle, yaw_rotation
from fg_nav.lab.simulation import scenario, simulate
from fg_nav.lab.simulation.fields import Dipoles, magnet
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import DISTURBED, NO_FIELD, QUASI_STATIC, UNKNOWN, find_gate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, differential, smooth, smooth_graph
from fg_nav.smoother.differential import (
    DifferentialFactors,
    LevelBias,
    add_differential_field,
    find_stretches,
    fit_variogram,
    measure_noise,
    turn_stretches,
)
from fg_nav.smoother.field import MAX_WINDOW, MIN_SEEN, measure_drift, remove_drift
from fg_nav.smoother.graph import KINDS, WalkProblem, count_graph, solve, turn_walk
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import list_poses
from fg_nav.smoother.strides import place_nodes
from fg_nav.solution import Solution
from fg_nav.walk import Options, Walk
from tests.smoother.walks import (
    DEFAULT,
    NOT_RESTED,
    demo,
    heading_error_deg,
    in_field,
    part,
    replace_field,
    track_of,
)
from tests.smoother.walks import smoothed as smoothed_without

STRENGTH, UP = 20.0, -43.0
STRIDES = find_gate(FieldParameters().gate).rows - 1
"""Strides that the gate compares: the first footfalls are not judged, and a disturbed one disturbs the next."""


def earth(azimuth: float = 0.0) -> Floats:
    return np.array([STRENGTH * np.sin(azimuth), STRENGTH * np.cos(azimuth), UP])


def smoothed(
    recording: Recording,
    heading: float | None = 0.0,
    p: SmootherParameters = DEFAULT,
    seed: int = 0,
    field: FootfallField | None = None,
) -> Solution:
    stances = demo(seed).stances
    return smooth(recording, stances, p, heading, field=field or average_footfall_field(recording, stances))


def footfalls(word: str, found: Solution) -> list[int]:
    return [k for k, each in enumerate(found.stances.field) if each == word]


@cache
def plain() -> Recording:
    return in_field(earth())


@cache
def drifted() -> Solution:
    """Without a field a bias of 0.2 deg/s turns the walk."""
    return smooth(in_field(earth(), bias_deg_s=0.2), demo().stances, NOT_RESTED)


# --- a homogeneous field


@pytest.mark.parametrize("heading", [0.0, None], ids=["told", "not told"])
@pytest.mark.parametrize("potential", [True, False], ids=["with potential", "compass alone"])
def test_in_a_homogeneous_field_a_gyro_bias_turns_nothing(heading: float | None, potential: bool) -> None:
    drifting = in_field(earth(), bias_deg_s=0.2)
    found = smoothed(drifting, heading, replace_field(NOT_RESTED, potential=potential))
    assert np.abs(heading_error_deg(found)).max() < 0.4
    assert np.abs(heading_error_deg(drifted())).max() > 15.0
    assert found.stances.field[:STRIDES] == (UNKNOWN,) * STRIDES
    assert set(found.stances.field[STRIDES:]) == {QUASI_STATIC}


@pytest.mark.parametrize("azimuth_deg", [70.0, 180.0])
def test_a_heading_that_is_not_given_is_that_from_magnetic_north(azimuth_deg: float) -> None:
    found = smoothed(in_field(earth(np.radians(azimuth_deg))), None)
    off = wrap_angle(np.radians(heading_error_deg(found) + azimuth_deg))
    np.testing.assert_allclose(np.degrees(off), 0.0, atol=0.4)
    north = plain().truth.position @ rotation(azimuth_deg).T
    np.testing.assert_allclose(found.position, north - north[0], atol=0.5)


def rotation(degrees: float) -> Floats:
    """Counter-clockwise about up."""
    return yaw_rotation(np.radians(degrees))


@pytest.mark.parametrize("azimuth_deg", [-3.0, 12.0, -90.0, 180.0])
def test_where_the_heading_is_given_the_field_s_direction_is_found(azimuth_deg: float) -> None:
    """However far from north it points: a heading that is wrong turns the walk, and must not bend it."""
    found = smoothed(in_field(earth(np.radians(azimuth_deg))))
    np.testing.assert_allclose(heading_error_deg(found), 0.0, atol=1.0)
    ((strength, direction),) = re.findall(r"field over ground ([\d.]+) uT, ([+-][\d.]+) deg", " ".join(found.notes))
    assert float(strength) == pytest.approx(STRENGTH, abs=0.5)
    assert np.degrees(wrap_angle(np.radians(float(direction) - azimuth_deg))) == pytest.approx(0.0, abs=1.0)


def roughened(recording: Recording, seed: int) -> FootfallField:
    """The field at its footfalls, and 3 uT a component that are new at each of them."""
    field, rng = average_footfall_field(recording, demo(seed).stances), np.random.default_rng(seed)
    return replace(field, body_field=field.body_field + 3.0 * rng.standard_normal(field.body_field.shape))


@pytest.mark.parametrize("rough", [False, True], ids=["homogeneous", "rough"])
def test_whether_a_heading_is_told_turns_the_walk_and_changes_nothing_else(rough: bool) -> None:
    """Eight degrees from where it was told to be."""
    recording = in_field(earth(np.radians(8.0)), bias_deg_s=0.1)
    field = roughened(recording, 0) if rough else None
    told, turned = (smoothed(recording, heading, NOT_RESTED, field=field) for heading in (0.0, None))
    off = wrap_angle(compute_heading(turned.stances.nav_R_body) - compute_heading(told.stances.nav_R_body))
    assert np.ptp(np.degrees(off)) < 0.15
    back = turned.stances.position @ rotation(np.degrees(off).mean()).T
    np.testing.assert_allclose(back, told.stances.position, atol=0.02)


def test_the_claimed_sigma_of_the_heading_is_honest() -> None:
    """In a field that is another at each footfall, 3 uT a component: 8 deg of compass; no gyroscope scale."""
    normed, claimed = [], []
    p = replace(NOT_RESTED, gyro_scale=False, gyr_density_deg_s=0.015)  # noise of the simulated gyroscope
    for seed in range(8):
        recording = in_field(earth(), seed, 0.1)
        found = smoothed(recording, None, p, seed, roughened(recording, seed))
        some = [0, 15, 30, 45, -1]
        normed.append(heading_error_deg(found, seed)[some] / np.degrees(found.stances.heading_sigma[some]))
        claimed.append(np.degrees(found.stances.heading_sigma[some]))
    assert 0.3 < np.sqrt(np.mean(np.square(normed))) < 1.66  # eight walks, each one error that drifts: 99 % band
    assert np.max(claimed) < 12.0  # a compass is 8.6 deg, and a region may be off as well


def test_its_doubt_about_north_is_in_all_its_poses() -> None:
    """As if the whole walk, by a gyroscope that does not drift, were turned about its start by one angle."""
    recording, bias = in_field(earth()), {"gyro_bias_sigma_deg_s": 1e-3, "gyro_bias_walk_deg_s": 1e-5}
    noise = {"gyr_density_deg_s": 1e-3, "gyr_relative_density": 1e-5, "moving_foot": False, "gyro_scale": False}
    p = replace(DEFAULT, choose_swing_noise=False, choose_bias_walk=False, **bias, **noise)
    field, p = roughened(recording, 0), replace_field(p, potential=False, differential=False)
    told, turned = (smoothed(recording, heading, p, field=field).stances for heading in (0.0, None))
    more = turned.pose_cov - told.pose_cov
    north = np.sqrt(more[:, 3, 3].mean())
    assert np.radians(0.5) < north < np.radians(12.0)
    step = 1e-6
    by_turn = (turned.position @ rotation(np.degrees(step)).T - turned.position) / step
    lever = np.column_stack([by_turn, np.ones(len(by_turn))])
    expected = north**2 * lever[:, :, None] * lever[:, None, :]
    np.testing.assert_allclose(more, expected, atol=0.02 * np.abs(expected).max())


def test_hard_iron_upward_is_found_in_the_swing() -> None:
    """The line integral sees it, which a footfall does not."""
    found = smoothed(in_field(earth(), iron=np.array([0.0, 0.0, 10.0])))
    (iron,) = re.findall(r"hard iron left in the stance's axes: (.*) uT", " ".join(found.notes))
    forward, left, up = (float(one) for one in iron.split(", "))
    assert up == pytest.approx(10.0, abs=2.5)
    # In a homogeneous field iron forward and upward are nearly one for a foot that stands level.
    assert abs(left) < 1.0
    assert abs(forward) < 5.0
    assert np.abs(heading_error_deg(found)).max() < 0.6


# --- magnets


def near(k: int, strength: float = 1.0) -> Dipoles:
    """A magnet a hand's breadth from a footfall."""
    recording, stances = demo().recording, demo().stances
    place = recording.truth.position[stances.stillest(recording.gyr)[k]]
    return magnet(place + np.array([0.25, 0.1, -0.1]), strength * np.array([3.0, -2.0, 1.0]))


@pytest.mark.parametrize("heading", [0.0, None], ids=["told", "not told"])
@pytest.mark.parametrize("potential", [True, False], ids=["with potential", "compass alone"])
def test_a_magnet_beside_the_way_is_seen_and_turns_nobody(heading: float | None, potential: bool) -> None:
    """With no gate the robust noise holds it alone."""
    recording = in_field(lambda x: earth() + near(20).at(x))
    for gate in ("ma2018", "none"):
        found = smoothed(recording, heading, replace_field(potential=potential, gate=gate))
        assert ("times the threshold" in found.stances.field_reason[20]) == (gate != "none")
        error = heading_error_deg(found)
        assert np.abs(np.diff(error)).max() < (0.1 if gate != "none" else 0.5)
        assert np.abs(error).max() < 0.5


def test_what_a_hard_gate_rejects_is_not_in_the_graph() -> None:
    """Whatever the field is there."""
    recording = in_field(lambda x: earth() + near(20, 10.0).at(x))
    field, p = average_footfall_field(recording, demo().stances), replace_field(gate="ma2018:hard")
    other = field.body_field.copy()
    other[20] += np.array([30.0, -20.0, 10.0])
    one, two = (smoothed(recording, p=p, field=replace(field, body_field=each)) for each in (field.body_field, other))
    assert one.stances.field == two.stances.field
    assert footfalls(DISTURBED, one) == list(range(20, 21 + STRIDES))
    assert one.graph["magnetic_heading"] == len(field) - 1 - 2 * STRIDES  # the first ones are not judged
    # But for the mean field, by which the solver's first values are turned.
    np.testing.assert_allclose(one.position, two.position, atol=8e-3)
    np.testing.assert_allclose(one.stances.heading_sigma, two.stances.heading_sigma, rtol=1e-2)


# --- where there is no field


def unseen(recording: Recording, rows: Bools) -> Recording:
    return replace(recording, mag=np.where(rows[:, None], np.nan, recording.mag))


@pytest.mark.parametrize(
    ("from_s", "to_s", "potential"), [(-1.0, 20.0, True), (45.0, 99.0, False), (25.0, 40.0, True), (25.0, 40.0, False)]
)
def test_a_stretch_without_a_field_is_walked_by_the_gyroscope(from_s: float, to_s: float, potential: bool) -> None:
    drifting = in_field(earth(), bias_deg_s=0.2)
    recording = unseen(drifting, (drifting.t > from_s) & (drifting.t < to_s))
    found = smoothed(recording, None, replace_field(NOT_RESTED, potential=potential))
    dark = np.flatnonzero((found.stances.t > from_s + 0.5) & (found.stances.t < to_s - 0.5))
    assert len(dark) > 10
    assert {(found.stances.field[k], found.stances.field_reason[k]) for k in dark} == {(UNKNOWN, NO_FIELD)}
    assert len(footfalls(QUASI_STATIC, found)) + len(footfalls(UNKNOWN, found)) == len(found.stances.field)
    assert np.abs(heading_error_deg(found)).max() < 2.0


def test_too_few_fields_and_those_near_the_magnetic_pole_are_left_alone() -> None:
    stances, p = demo().stances, replace_field(differential=False)
    last = stances.stop[np.flatnonzero(stances.footfall < MIN_SEEN - 1)[-1]]
    few = unseen(plain(), np.arange(len(plain().t)) >= last)
    expected = smoothed_without()
    for recording, words in (
        (few, f"the field was seen at {MIN_SEEN - 1} footfalls only"),
        (in_field(np.array([1.0, 2.0, -58.0])), "the field is 2.3 uT over ground, which is too little for a compass"),
    ):
        found = smoothed(recording, p=p)
        assert (set(found.stances.field), set(found.stances.field_reason)) == ({UNKNOWN}, {words})
        for name in ("position", "nav_R_body"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_array_equal(found.stances.heading_sigma, expected.stances.heading_sigma)
    seen = smoothed(in_field(np.array([2.0, 4.0, -58.0]))).stances.field
    assert set(seen[STRIDES:]) == {QUASI_STATIC}


def test_a_field_of_another_walk_is_refused() -> None:
    field = average_footfall_field(plain(), demo().stances)
    fewer = replace(field, **{name: value[1:] for name, value in vars(field).items()})
    with pytest.raises(EstimationError, match="take the field at these stances"):
        smooth(plain(), demo().stances, field=fewer)


@pytest.mark.parametrize("seed", [1, 2])
def test_north_on_a_rough_floor_is_found_within_its_sigma(seed: int) -> None:
    """A minute over a reinforced floor, iron on the shoe, nobody tells the heading: the mean field is all there is."""
    walk = simulate("demo", seed).recording
    stances = detect_stances(walk)
    found = smooth(walk, stances, heading=None, field=average_footfall_field(walk, stances)).stances
    truth = walk.truth
    off = wrap_angle(compute_heading(found.nav_R_body) - compute_heading(truth.nav_R_body[found.sample]))
    assert np.abs(off).max() < 3.0 * found.heading_sigma.min()
    assert np.degrees(found.heading_sigma.max()) < 8.0


@cache
def short_problem() -> WalkProblem:
    walk = part(demo(), 24)
    return walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)


STRIDE_S = 1.1


def field_of(drift: Floats, noise_uT: float = 8.0, alike_uT: float = 0.0, seed: int = 3) -> Floats:
    """The field at footfalls of a building with iron, as a heading that drifted by so much has it; some without."""
    rng, keep = np.random.default_rng(seed), np.exp(-1.3 / 3.0)
    new = alike_uT * np.sqrt(1.0 - keep**2) * rng.standard_normal((len(drift), 3))
    field = np.array([0.0, 21.0, -43.0]) + noise_uT * rng.standard_normal((len(drift), 3))
    field += lfilter([1.0], [1.0, -keep], new, axis=0)
    field[rng.random(len(drift)) < 0.1] = np.nan
    return np.einsum("kij,kj->ki", yaw_rotation(drift), field)


def times(count: int) -> Floats:
    return STRIDE_S * np.arange(count) + 5.0


@pytest.mark.parametrize("most", [1.0, -4.0])
def test_the_drift_of_hours_is_measured(most: float) -> None:
    drift = most * np.sin(np.linspace(0.0, 1.5, 8 * MAX_WINDOW))
    found = measure_drift(field_of(drift), times(len(drift)))
    # The first window has the drift of its middle.
    half = MAX_WINDOW // 2
    np.testing.assert_allclose((found - found[half])[half:-half], (drift - drift[half])[half:-half], atol=0.08)


@pytest.mark.parametrize("rate_deg_s", [-1.0, 0.3])
def test_a_constant_bias_is_measured_over_a_rough_floor(rate_deg_s: float) -> None:
    """At 1 deg/s 240 footfalls are more than half a turn, of which none is lost."""
    drift = np.radians(rate_deg_s) * (times(240) - 5.0)
    fields = [field_of(drift, 5.0, 4.0, seed) for seed in range(20)]
    off = np.array([measure_drift(field, times(240)) - drift for field in fields])
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert np.abs(off).max() < 1.0


def test_a_walk_that_was_bent_is_bent_back_and_one_that_was_not_is_left_as_it_is(monkeypatch) -> None:
    for bound in ("MIN_WINDOW", "MAX_WINDOW"):
        monkeypatch.setattr(f"fg_nav.smoother.field.{bound}", 4)
    problem = short_problem()
    nodes, count = problem.nodes, len(problem.nodes)
    footfalls = len(nodes.result)
    drift = np.interp(np.arange(footfalls), [2, footfalls - 2], [0.0, 1.2])
    field = field_of(drift, 0.0)
    field[np.isnan(field)] = 0.0
    bent = gtsam.Values(problem.values)
    turn_walk(bent, nodes, np.interp(np.arange(count), nodes.result, drift))
    t = times(footfalls)
    straight, moved, found = (
        list_poses(range(count), values) for values in (problem.values, bent, remove_drift(bent, nodes, field, t))
    )
    off, left = (np.linalg.norm(one[:, :3, 3] - straight[:, :3, 3], axis=1).max() for one in (moved, found))
    assert left < 0.1 * off
    same = field_of(np.full(footfalls, 0.5), 0.0)
    assert remove_drift(bent, nodes, same, t) is bent


def test_a_walk_is_turned_move_by_move() -> None:
    problem = short_problem()
    number, turned = range(len(problem.nodes)), gtsam.Values(problem.values)
    angle = 0.7 + np.linspace(0.0, 2.0, len(number))
    turn_walk(turned, problem.nodes, angle)
    before, after = (list_poses(number, values) for values in (problem.values, turned))
    moves = np.einsum("kij,kj->ki", yaw_rotation(angle[1:]), np.diff(before[:, :3, 3], axis=0))
    np.testing.assert_allclose(np.diff(after[:, :3, 3], axis=0), moves, atol=1e-9)
    np.testing.assert_allclose(after[:, :3, :3], yaw_rotation(angle) @ before[:, :3, :3], atol=1e-9)
    for j in number:
        velocity = yaw_rotation(angle[j]) @ problem.values.atVector(V(j))
        np.testing.assert_allclose(turned.atVector(V(j)), velocity, atol=1e-12)


COURSE = [Stand(3.0), Walking(straight(25.0)), Stand(3.0)]


@pytest.mark.parametrize("gate", ["none", "ma2018", "ma2018:hard"])
def test_the_graph_has_the_factors_that_the_summary_counts_and_the_weights_of_its_gate(gate: str) -> None:
    course = replace(scenario("demo"), name="short", route=lambda _: COURSE, field="indoor", worn="heel")
    options = Options(gate=gate)
    given = prepare_walk(Walk.of(simulate(course, 1).recording, options))
    walk = smooth_graph(given.recording, given.stances, choose_parameters(options), None, field=given.field)
    told = Counter({kind: count for kind, count in walk.solution.graph.items() if kind in KINDS and count})
    gated_out = told.pop("gated_out", 0)
    assert count_graph(walk.graph) == told
    assert told["differential_field"] > 0
    assert told["magnetic_heading"] + gated_out == len(walk.solution.stances)
    assert (gated_out > 0) == gate.endswith(":hard")
    table = walk.solution.stances
    weight, statistic = table.compass_weight, table.field_statistic
    assert weight is not None
    assert statistic is not None
    assert (weight > 0.0).sum() == walk.solution.graph["magnetic_heading"]
    assert (weight <= 1.0).all()
    judged = np.isfinite(statistic)
    if gate == "ma2018":
        order = np.argsort(statistic[judged])
        assert (np.diff(weight[judged][order]) <= 0.0).all()
        assert 0.0 < weight.min() < weight.max() == 1.0
    else:
        assert set(weight) <= {0.0, 1.0}


# --- what the stances show of the gyro bias


EARTH = np.array([1.0, 20.0, -43.0])
UNRESTED = replace_field(NOT_RESTED, compass=False, potential=False)
"""The differential field alone: no rest shows the bias, and no heading."""
UP_BIAS_DEG_S = 0.4


def waves(position: Floats) -> Floats:
    """A field (N, 3) uT without divergence that changes by some 3 uT over a metre: shear waves in many directions."""
    rng = np.random.default_rng(7)
    total = np.zeros_like(position)
    for _ in range(12):
        k = rng.normal(size=3)
        k *= 2.0 * np.pi / (2.5 * np.linalg.norm(k))
        across = np.cross(k, rng.normal(size=3))
        phase = position @ k + rng.uniform(0.0, 2.0 * np.pi)
        total += 1.2 * across / np.linalg.norm(across) * np.sin(phase)[:, None]
    return total


@cache
def recorded(rough: bool) -> Recording:
    """The demonstration with a magnetometer of 0.2 uT, and a gyroscope with a bias about up."""
    recording = in_field(lambda x: EARTH + waves(x) * rough, bias_deg_s=UP_BIAS_DEG_S)
    return replace(recording, mag=recording.mag + np.random.default_rng(0).normal(0.0, 0.2, recording.mag.shape))


def solved_walk(recording: Recording, p: SmootherParameters) -> tuple[WalkProblem, gtsam.Values]:
    problem = walk_problem(recording, demo().stances, 0.0, p)
    return problem, solve(problem).values


@cache
def with_factors(rough: bool) -> tuple[WalkProblem, gtsam.Values]:
    problem, values = solved_walk(recorded(rough), UNRESTED)
    return add_differential_field(problem, values, track_of(problem, values)), values


def factors_of(problem: WalkProblem) -> DifferentialFactors:
    return problem.get(DifferentialFactors)


def up_bias_deg_s(found: Solution) -> Floats:
    """Component about up of the gyro bias at the footfalls, deg/s."""
    up = demo().recording.truth.nav_R_body[found.stances.sample, 2]
    return np.degrees((found.stances.gyro_bias * up).sum(axis=1))


@pytest.mark.parametrize("rough", [False, True], ids=["homogeneous", "rough"])
def test_without_a_rest_the_bias_is_found_better(rough: bool) -> None:
    recording, stances = recorded(rough), demo().stances
    field = average_footfall_field(recording, stances)
    with_it = up_bias_deg_s(smooth(recording, stances, UNRESTED, field=field))
    without = up_bias_deg_s(smooth(recording, stances, UNRESTED))
    own = up_bias_deg_s(smoothed_without())  # of the sensor, from its rests
    true = own.mean() + UP_BIAS_DEG_S
    # Against a prior of 0.15 deg/s, and an error of 0.2 that the stances of a walk have in common.
    assert abs(with_it[-1] - true) < 0.85 * abs(without[-1] - true)


def test_the_noise_of_the_magnetometer_is_found() -> None:
    recording = recorded(True)
    stretches = find_stretches(recording, place_nodes(recording, demo().stances, DEFAULT), ())
    bias = np.zeros((len(stretches.start), 3))
    turned = turn_stretches(recording, stretches, recording.truth.position, bias)
    assert measure_noise(turned) == pytest.approx(0.2, rel=0.1)


def test_the_variogram_of_the_swings_is_that_of_the_field() -> None:
    recording = recorded(True)
    truth = recording.truth
    nodes = place_nodes(recording, demo().stances, DEFAULT)
    found = fit_variogram(recording.mag, truth.position, truth.nav_R_body, nodes, 0.2)
    assert found is not None
    rng = np.random.default_rng(3)
    place, direction = truth.position[rng.integers(0, len(truth.position), 4000)], rng.normal(size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for r in (0.1, 0.3):
        true = np.mean((waves(place + r * direction) - waves(place)) ** 2) / 2.0
        gamma = found.sigma_uT**2 - float(found.covariance(np.array(r**2)))
        assert 0.4 < gamma / true < 2.5


def test_a_field_that_is_not_of_the_model_is_left_out() -> None:
    recording = recorded(False)
    stretches = find_stretches(recording, place_nodes(recording, demo().stances, DEFAULT), ())
    third = int(stretches.start[3] + stretches.stop[3]) // 2
    jump = recording.mag.copy()
    jump[third:] += 30.0  # something that moves in the middle of a stance
    problem, values = solved_walk(replace(recording, mag=jump), UNRESTED)
    before = factors_of(with_factors(False)[0])
    after = factors_of(add_differential_field(problem, values, track_of(problem, values)))
    counts = [one.stances.count.sum() + one.standings.count.sum() for one in (after, before)]
    assert counts[0] < counts[1]


def test_what_contradicts_gravity_is_weakened_about_all_axes_and_nothing_else() -> None:
    """Sigma of 0.1 deg/s each: what is off about up may be right, what is as much off about a level axis is not."""
    up, sigma = np.array([0.0, 0.6, 0.8]), math.radians(0.1)
    off = np.array([np.zeros(3), 10 * sigma * up, 10 * sigma * np.array([1.0, 0.0, 0.0])])
    shown = BiasInformation(np.tile(np.eye(3) / sigma**2, (3, 1, 1)), off / sigma**2)
    weaker = LevelBias(np.zeros((3, 3)), up).weaken(shown)
    of_gravity = math.radians(differential.LEVEL_SIGMA_DEG_S)
    ratio = 0.5 * (10 * sigma) ** 2 / (sigma**2 + of_gravity**2)
    weight = np.array([1.0, 1.0, differential.MAX_LEVEL_RATIO / ratio])
    np.testing.assert_allclose(weaker.matrix, shown.matrix * weight[:, None, None], rtol=1e-5)
    np.testing.assert_allclose(weaker.vector, shown.vector * weight[:, None], rtol=1e-5, atol=1e-9)
