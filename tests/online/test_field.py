"""The magnetic field while the walk goes on: its gates, a magnet, what is known of north, delay and axes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.detection.causal import join_footfalls
from fg_nav.frames import UNKNOWN_RAD, compute_heading
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.detectors import DEFAULT, GATES, HARD, NO_GATE, QUASI_STATIC, apply_gate, find_gate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.field import (
    FLOOR_UT,
    FLOOR_WEIGHT,
    ROOM_SHARE,
    average_along,
    extend_with_north,
    find_north_sigma,
)
from fg_nav.online.resolve import measure_online_field
from fg_nav.smoother.parameters import FieldParameters, SmootherParameters
from tests.magnetic.turning_walks import minute
from tests.online.walks import NORTH, estimates_of, push, short_walk, solve_in_windows, solve_only_at, walked


@pytest.mark.parametrize("gate", GATES)
def test_a_gate_judges_a_walk_in_progress_as_in_batch_and_weighs_by_it(gate):
    parameters = SmootherParameters(magnetic=FieldParameters(gate=gate))
    navigator, _ = walked(rows_of(short_walk(8)), OnlineOptions(heading_rad=0.0, parameters=parameters))
    found = navigator.finish()
    assert np.isfinite(found.stances.position).all()
    # on the same footfalls, with the attitudes of the batch
    recording = navigator.recording()
    stances = join_footfalls(navigator.footfalls, len(recording))
    field = measure_online_field(recording, stances, navigator.options).field
    passed = np.array([word == QUASI_STATIC for word in found.stances.field])
    expected = np.array([word == QUASI_STATIC for word in apply_gate(field, gate).words])
    assert (passed == expected[: len(passed)]).mean() > 0.75
    assert passed.any()
    assert passed.all() or gate != NO_GATE
    weight = found.stances.compass_weight
    assert ((weight >= 0.0) & (weight <= 1.0)).all()
    if gate == NO_GATE or gate.endswith(HARD):
        np.testing.assert_allclose(weight, passed, atol=1e-9)  # all alike, or the papers' switch
    else:
        assert (weight > 0.0).sum() >= passed.sum()


# --- past a magnet ---------------------------------------------------------------------------------------------------

SOLVED_AGAIN = (1, 2, 3, 4)  # Footfalls; those behind are judged by the walk in progress.
AT, NEAR = 8, 8  # Footfall at the magnet, and samples before and after the stance that it reaches.
MAGNET_UT = np.array([50.0, -36.0, 24.0])


def past(field_there: np.ndarray | float, lag_s: float | None = None, compass_alone: bool = False) -> OnlineNavigator:
    """The navigator of a walk in whose field there is something more at one footfall."""
    recording = short_walk(16)
    stances, rows = detect_stances(recording), rows_of(recording)
    of = stances.footfall == AT
    rows[stances.start[of][0] - NEAR : stances.stop[of][-1] + NEAR, 7:10] += field_there
    more = not compass_alone
    magnetic = replace(NORTH.parameters.magnetic, differential=more, potential=more)
    parameters = replace(NORTH.parameters, magnetic=magnetic)
    return walked(rows, replace(NORTH, lag_s=lag_s, parameters=parameters))[0]


@pytest.fixture(scope="module")
def magnet():
    """Past the magnet, and the same walk without it."""
    with pytest.MonkeyPatch.context() as patched:
        solve_only_at(patched, *SOLVED_AGAIN)
        return past(MAGNET_UT), past(0.0)


def test_footfalls_in_the_window_of_the_gate_that_holds_a_magnet_are_disturbed_and_the_heading_stays(magnet):
    disturbed, without = magnet
    field, window = disturbed.finish().moment.field, slice(AT, AT + find_gate(DEFAULT).rows)
    assert set(field[window]) == {"disturbed"}
    assert set(field[SOLVED_AGAIN[-1] : AT] + field[window.stop :]) == {"quasi-static"}
    assert "disturbed" not in without.causal().field
    # What footfalls that weigh less do not show: two estimates, the one of a part of what the other has, differ by the
    # difference of their variances (Hausman 1978).
    one, other = (walk.causal() for walk in magnet)
    lost = np.sqrt(np.maximum(one.heading_sigma**2 - other.heading_sigma**2, 0.0))
    turned = compute_heading(one.nav_R_body) - compute_heading(other.nav_R_body)
    assert (np.abs(turned) < 2.0 * lost + np.radians(0.05)).all()
    lost_m = np.sqrt(np.maximum(one.position_sigma**2 - other.position_sigma**2, 0.0))
    assert (np.abs(one.position - other.position) < 2.0 * lost_m + 0.05).all()


def test_its_compass_weighs_next_to_nothing(monkeypatch):
    """By its compass alone, all is at that footfall nearly as if there had been no sample of the field.

    Its variance follows the gate's statistic, and its loss is robust: at 27 sigmas a hundredth of the weight is left.
    """
    solve_only_at(monkeypatch, *SOLVED_AGAIN)
    disturbed, unseen, clean = (past(there, compass_alone=True).causal() for there in (MAGNET_UT, np.nan, 0.0))
    assert unseen.field[AT] == "none"
    assert unseen.compass_weight[AT] == 0.0
    assert 0.0 < disturbed.compass_weight[AT] < 0.2
    np.testing.assert_allclose(disturbed.nav_R_body[AT], unseen.nav_R_body[AT], atol=1e-3)
    np.testing.assert_allclose(*(np.diagonal(one.pose_cov[AT]) for one in (disturbed, unseen)), rtol=0.01)
    # What it shows of the heading, 1/rad^2, and would without the magnet.
    shown, whole = (one.heading_sigma[AT] ** -2 - unseen.heading_sigma[AT] ** -2 for one in (disturbed, clean))
    assert 0.0 < shown < 0.02 * whole
    assert whole > np.radians(4.0) ** -2


@pytest.mark.parametrize("lag_s", [None, 6.0])
def test_what_is_solved_again_in_windows_keeps_its_verdicts(monkeypatch, lag_s):
    solve_only_at(monkeypatch, *SOLVED_AGAIN)
    solve_in_windows(monkeypatch, behind=6, window=4)
    field = past(MAGNET_UT, lag_s).smoothed().field
    assert field[AT] == "disturbed"
    assert "quasi-static" in field[:AT]
    assert "quasi-static" in field[AT + find_gate(DEFAULT).rows :]


# --- what is known of north ------------------------------------------------------------------------------------------

STRENGTH_UT = 20.0


def test_the_mean_of_a_correlated_deviation_varies_as_it_is_told():
    """The mean over 20 m of an exponentially correlated process, drawn: its variance is v."""
    rng, step, length, n = np.random.default_rng(1), 0.1, 1.5, 200
    keep = np.exp(-step / length)
    x = rng.standard_normal(20000)
    total = np.zeros(20000)
    for _ in range(n):
        total += x
        x = keep * x + np.sqrt(1.0 - keep**2) * rng.standard_normal(20000)
    assert (total / n).var() == pytest.approx(average_along(n * step / length), rel=0.03)
    assert average_along(0.0) == 1.0
    assert average_along(0.9999e-4) == pytest.approx(average_along(1.0001e-4), abs=1e-8)


def test_north_is_known_better_the_farther_the_walk_and_the_steadier_its_field():
    rough = 7.0 * np.random.default_rng(2).standard_normal(400)
    by_path = [find_north_sigma(rough[:n], 1.3 * n, STRENGTH_UT) for n in (4, 40, 400)]
    assert by_path[0] > 2.0 * by_path[1] > 4.0 * by_path[2]
    assert find_north_sigma(0.05 * rough[:40], 52.0, STRENGTH_UT) < 0.5 * by_path[1]
    assert find_north_sigma(np.zeros(4), 4.0, STRENGTH_UT) > np.radians(8.0)  # that agree, and may all be off
    # Of one place: both deviations are independent, a room's is a share of the floor's, and deviations count as seen.
    for across in ([0.0], [3.0, -4.0], [12.0, 5.0, 0.0]):
        variance = (FLOOR_WEIGHT * FLOOR_UT**2 + np.dot(across, across)) / (FLOOR_WEIGHT + len(across) - 1)
        expected = np.sqrt(variance) * np.hypot(1.0, ROOM_SHARE) / STRENGTH_UT
        assert find_north_sigma(np.array(across), 0.0, STRENGTH_UT) == pytest.approx(expected)
    with np.errstate(all="raise"):
        for strength_uT in (0.1, 0.0):  # without a horizontal part it shows nothing
            assert find_north_sigma(np.full(4, 5.0), 4.0, strength_uT) == UNKNOWN_RAD


@pytest.mark.parametrize("sigma", [0.02, 0.5, UNKNOWN_RAD])
def test_a_pose_moves_as_a_turn_about_the_origin_moves_it(sigma):
    rng, position = np.random.default_rng(3), np.array([3.0, -4.0, 1.0])
    theta = sigma * rng.standard_normal(400_000)
    at = (position[0] + 1j * position[1]) * (np.exp(1j * theta) - 1.0)
    drawn = np.stack([at.real, at.imag, np.zeros(len(theta)), theta])
    told = extend_with_north(np.zeros((4, 4)), position, sigma)
    np.testing.assert_allclose(told, drawn @ drawn.T / len(theta), atol=0.02 * told.max())
    assert np.linalg.eigvalsh(told).min() > -1e-9
    # What the heading knows of it is not counted twice.
    known = np.diag([0.1, 0.1, 0.1, 0.2]) ** 2
    np.testing.assert_allclose(extend_with_north(known, np.ones(3), 0.1), known)
    assert extend_with_north(known, np.zeros(3), 0.5)[3, 3] == pytest.approx(0.25)


def test_an_unknown_north_is_in_the_lines_until_the_field_shows_it_or_nothing_is_to_show_it():
    rows = rows_of(short_walk())
    lines = estimates_of(walked(rows, OnlineOptions(heading_rad=None))[1])
    heading = np.array([np.sqrt(line.pose_cov[3, 3]) for line in lines])
    assert heading[:3].min() >= UNKNOWN_RAD
    assert heading[-1] < np.radians(15.0)
    across = np.array([np.sqrt(line.pose_cov[0, 0]) for line in lines])
    along = np.array([np.hypot(*line.position[:2]) for line in lines])
    assert across[2] > 0.5 * along[2]
    assert across[-1] < 0.25 * along[-1]
    bare = rows.copy()
    bare[:, 7:10] = np.nan
    unused = OnlineOptions(heading_rad=None, use_field=False)
    for name, some, options in (
        ("given", rows, NORTH),
        ("no magnetometer", bare, OnlineOptions(heading_rad=None)),
        ("field not used", rows, unused),
    ):
        first = estimates_of(push(OnlineNavigator(options), some[:500]))[0]
        assert np.sqrt(first.pose_cov[3, 3]) < np.radians(1.0), name


# --- delay and axes of the magnetometer ------------------------------------------------------------------------------

LATE_S = 0.022


@cache
def late_walk() -> np.ndarray:
    return rows_of(replace(minute(5, LATE_S, rate_hz=100.0), truth=None).slice(0, 2700))


def test_the_delay_is_found_on_the_way_and_taken_off_what_follows():
    navigator = OnlineNavigator(NORTH)
    push(navigator, late_walk())
    walk = navigator.smoother.walk
    delay = walk.sensor.magnetometer.delay
    assert delay.taken_off
    assert delay.tau_s == pytest.approx(LATE_S, abs=0.0015)
    right = minute(5, 0.0, "indoor", 100.0).mag[: walk.stop]
    cut = walk.cut_whole().mag
    known = np.isfinite(cut).all(axis=1)
    assert np.flatnonzero(~known).min() >= len(cut) - 4
    error, before = (mag[known] - right[known] for mag in (cut, late_walk()[: walk.stop, 7:10]))
    assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(before**2))
    np.testing.assert_allclose(walk.cut_recording(walk.stop - 500).mag, cut[-500:], atol=1e-9)
    for notes in (navigator.smoother.initial.notes, navigator.finish().notes):
        assert any("ms late" in note for note in notes)


def test_wrong_axes_are_said_once_and_not_used():
    rows, said = late_walk().copy(), list[str]()
    rows[:, 7:10] = rows[:, 7:10] @ MagAxes.parse("y,x,z").P
    navigator = OnlineNavigator(NORTH, said.append)
    push(navigator, rows)
    assert sum("--mag-axes=y,x,z" in words for words in said) == 1
    assert navigator.smoother.walk.cut_whole().mag is None
