"""The filter and the way back over it: walks whose truth is known, a dense smoother that inverts, and real walks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.ekf import OPENSHOE, core, run_iez
from fg_nav.ekf.core import IezParameters, filter_walk, make_initial_state
from fg_nav.ekf.covariance import SIZE, VELOCITY, compute_densities, propagate_columns
from fg_nav.ekf.measurements import make_pseudo_measurements
from fg_nav.ekf.update import INNOVATION, ROW, VARIANCE
from fg_nav.errors import EstimationError
from fg_nav.evaluation import align, evaluate, fit_scale
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.io import read
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from tests.ekf.motion import Walk
from tests.real_data import DATA, needs_data

WALK = Walk(strides=20, turn=0.1)
NORTH = yaw_rotation(np.pi / 2)  # With heading 0 the body's x axis points north; the walk's truth starts eastward.


@pytest.fixture(scope="module")
def clean():
    return WALK.recording()


def shaken(recording, gyro_bias=(0.0, 0.0, 0.0)):
    rng = np.random.default_rng(0)
    gyr = recording.gyr + 0.002 * rng.standard_normal(recording.gyr.shape) + gyro_bias
    return replace(recording, gyr=gyr, acc=recording.acc + 0.02 * rng.standard_normal(recording.acc.shape))


def test_a_clean_walk_is_found_again(clean):
    recording, stances = clean
    solution = run_iez(recording, stances)
    assert np.abs(solution.position - WALK.position(recording.t) @ NORTH.T).max() < 0.02
    assert np.abs(solution.velocity - WALK.velocity(recording.t) @ NORTH.T).max() < 0.02
    off = Rotation.from_matrix(NORTH @ WALK.attitude(recording.t) @ np.swapaxes(solution.nav_R_body, 1, 2))
    assert np.degrees(off.magnitude().max()) < 0.1
    assert len(solution.stances) == WALK.strides + 1


@pytest.mark.parametrize("heading", [0.5, -2.0, 3.0])
def test_the_initial_heading_turns_the_whole_walk(clean, heading):
    recording, stances = shaken(clean[0]), clean[1]
    straight, turned = (run_iez(recording, stances, heading=angle) for angle in (0.0, heading))
    turn = yaw_rotation(-heading)  # clockwise from north
    assert compute_heading(turned.nav_R_body[0]) == pytest.approx(heading)
    np.testing.assert_allclose(turned.position, straight.position @ turn.T, atol=1e-6)
    np.testing.assert_allclose(turned.nav_R_body, turn @ straight.nav_R_body, atol=1e-6)
    np.testing.assert_allclose(turned.stances.position_cov, turn @ straight.stances.position_cov @ turn.T, atol=1e-6)


def test_a_sensor_mounted_any_way_gives_the_same_walk(clean):
    recording, mount = shaken(clean[0]), np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    tilted = replace(recording, acc=recording.acc @ mount.T, gyr=recording.gyr @ mount.T)
    a, b = (run_iez(r, clean[1]).position for r in (recording, tilted))
    np.testing.assert_allclose(align(a, b).apply(a), b, atol=1e-4)


def test_a_wrong_start_is_corrected_by_the_stances(clean):
    """A wrong sign anywhere between innovation and correction drives the tilt away instead."""
    recording, stances = clean
    start, rows = find_start(recording, stances), stances.stillest(recording.gyr)
    for axis in "xy":
        turn = Rotation.from_euler(axis, 2.0, degrees=True).as_matrix()
        wrong = replace(start, nav_R_body=turn @ start.nav_R_body, levelled_at_rest=False)
        track = filter_walk(recording, stances.mask, rows, wrong, IezParameters())
        assert np.degrees(np.arccos(min(track.nav_R_body[rows[-1]][2, 2], 1.0))) < 0.1


def test_gyro_bias_is_taken_from_a_rest(clean):
    recording, stances = clean
    bias = np.radians([0.5, -0.4, 0.3])
    solution = run_iez(shaken(recording, gyro_bias=bias), stances)
    error = np.abs(solution.stances.gyro_bias[-1] - bias)
    assert np.all(np.degrees(error) < 0.06)
    assert np.all(error < 3 * solution.stances.gyro_bias_sigma[-1])
    assert solution.notes[0].startswith("gyro bias from a rest of 2")
    assert fit_scale(solution.position, WALK.position(recording.t)) == pytest.approx(1.0, abs=0.005)


def test_a_walk_that_begins_in_mid_swing_is_followed_backward_from_its_first_stance(clean):
    recording, stances = clean
    cut = int((WALK.rest_s + 0.3) * 200)
    part, mask = recording.slice(cut, len(recording)), stances.mask[cut:]
    solution, truth, first = run_iez(part, Stances.from_mask(mask)), WALK.position(part.t), int(np.argmax(mask))
    assert first > 0
    ours = align(solution.position[first:], truth[first:]).apply(solution.position)
    assert np.abs(ours - truth)[:first].max() < 0.02
    assert np.linalg.norm(truth[0] - truth[first]) > 0.5
    assert solution.notes[0].startswith("no rest at the start")


def test_claims_do_not_hang_on_the_sampling_rate():
    tables = [run_iez(*WALK.recording(rate)).stances for rate in (100.0, 400.0)]
    one, other = ([*t.position_sigma[-1], t.heading_sigma[-1], *t.gyro_bias_sigma[-1]] for t in tables)
    np.testing.assert_allclose(one, other, rtol=0.1)


def test_a_rolling_foot_makes_plain_zero_velocity_short_and_its_height_mends_that():
    walk = Walk(strides=20, turn=0.05, roll=-0.3, height=0.06, stance_s=0.5)
    recording, stances = walk.recording()
    plain, rolled = (run_iez(recording, stances, parameters) for parameters in (OPENSHOE, IezParameters()))
    truth = walk.position(recording.t)
    assert fit_scale(plain.position, truth) > 1.012
    assert fit_scale(rolled.position, truth) == pytest.approx(1.0, abs=0.003)


def test_a_clipped_gyroscope_hurts_little_and_its_samples_get_extra_noise():
    """The flat tops are found in the recording, the foot's peaks being cut by a tenth, and are rebuilt."""
    walk = replace(WALK, pitch=1.2)
    recording, stances = walk.recording()
    limit = 0.9 * np.abs(recording.gyr).max()
    clipped = replace(recording, gyr=np.clip(shaken(recording).gyr, -limit, limit))
    aware, unaware = (run_iez(clipped, stances, IezParameters(saturated_share=share)) for share in (0.3, 0.0))
    assert evaluate(aware, TrajectoryTruth(recording.t, walk.position(recording.t))).rmse_3d_m < 0.01
    assert np.all(aware.stances.position_sigma[-1] > unaware.stances.position_sigma[-1])


def test_samples_before_a_gap_get_extra_noise():
    """In a swing that nothing else in the recording is like, the extra variance covers the error of the gap."""
    recording, stances = replace(WALK, strides=1).recording()
    swing = int((WALK.rest_s + 0.25) * 200)
    keep = np.delete(np.arange(len(recording)), range(swing + 1, swing + 15))
    holed = Recording(t=recording.t[keep], acc=recording.acc[keep], gyr=recording.gyr[keep])
    tables = run_iez(holed, Stances.from_mask(stances.mask[keep])).stances, run_iez(recording, stances).stances
    error = np.linalg.norm(tables[0].position[1] - tables[1].position[1])
    claims = [np.linalg.norm(table.position_sigma[1]) for table in tables]
    assert error > 0.005
    assert 0.6 * error < np.sqrt(claims[0] ** 2 - claims[1] ** 2) < 2.5 * error


def test_what_cannot_be_navigated_is_said(clean):
    recording, stances = clean
    weightless = replace(recording, acc=recording.acc - [0.0, 0.0, 9.80665])
    for arguments, words in (
        ((recording, Stances.from_mask(0 * stances.mask > 0)), "no stance to start from"),
        ((recording.slice(0, 1000), stances), r"belong to \d+ samples and the recording has \d+"),
        ((weightless, stances), "there is no up: accelerations must include gravity"),
        ((recording, stances, IezParameters(gravity=np.inf)), r"diverged to infinity at 0\.005 s"),
    ):
        with pytest.raises(EstimationError, match=words):
            run_iez(*arguments)


@needs_data
def test_real_walks_are_no_worse_than_pyshoe_s_and_the_claimed_sigmas_mean_something():
    """Against the rmse in m, horizontal and in space, of PyShoe's own EKF on these trials with the same labels."""
    rows = []
    for path in sorted((DATA / "vicon").glob("*.mat")):
        recording = read(path)
        solution = run_iez(recording, Stances.from_mask(read_pyshoe_labels(path, "shoe")))
        metrics = evaluate(solution, recording.truth)
        nees = compute_stance_nees(solution.stances, recording.truth).median_ratio
        rows.append((metrics.rmse_2d_m, metrics.rmse_3d_m, metrics.scale, nees))
    rmse, median = np.array(rows)[:, :2], np.median(rows, axis=0)
    assert len(rows) == 28
    assert np.all(rmse.mean(axis=0) <= (0.079, 0.131))
    assert np.all(median[:2] <= (0.055, 0.087))
    assert 0.6 < median[3] < 1.6
    assert median[2] == pytest.approx(1.0, abs=0.015)


SHORT_WALK = Walk(strides=4, rest_s=0.6, roll=0.3, height=0.06)
START_SIGMA = np.radians(5.0)


def noisy(seed, rate_hz=100.0, gap=None, since_s=0.0):
    """Recording with noise, a biased gyroscope, an eighth of a second missing; stances, and what footfalls measure."""
    rng = np.random.default_rng(seed)
    recording, stances = SHORT_WALK.recording(rate_hz)
    acc = recording.acc + 0.05 * rng.standard_normal(recording.acc.shape)
    gyr = recording.gyr + np.radians(0.3) * rng.standard_normal(recording.gyr.shape) + np.radians([0.1, -0.1, 0.15])
    kept = np.arange(round(since_s * rate_hz), len(acc))
    if gap is not None:
        kept = np.r_[0:gap, gap + round(rate_hz / 8) : len(acc)]
    recording = replace(recording, t=recording.t[kept], acc=acc[kept], gyr=gyr[kept])
    stances = type(stances).from_mask(stances.mask[kept])
    return recording, stances, measure_footfalls(recording, stances.stillest(recording.gyr), rng)


def measure_footfalls(recording, rows, rng):
    """Compass, up and a steady course, as a sensor on this walk would measure them, with noise."""
    attitude, k = SHORT_WALK.attitude(recording.t[rows]), len(rows)
    vectors = [np.einsum("kji,j->ki", attitude, v) for v in ([0.0, 20.0, -45.0], [0.0, 0.0, 9.8])]
    field, force = (v + 0.02 * np.linalg.norm(v[0]) * rng.standard_normal(v.shape) for v in vectors)
    return make_pseudo_measurements(k)._replace(
        body_field=field,
        body_force=force,
        compass_variance=np.where(np.arange(k) % 2 == 0, np.radians(3.0) ** 2, np.nan),
        tilt_variance=np.full(k, np.radians(1.0) ** 2),
        course_variance=np.full(k, np.radians(4.0) ** 2),
        course_limit=1.0,
        course_strides=1,
    )


def both(recording, stances, pseudo, wrong_heading, parameters=IezParameters()):
    """Track of the filter and of the smoother over it, and the footfalls' samples."""
    rows = stances.stillest(recording.gyr)
    start = find_start(recording, stances, float(compute_heading(SHORT_WALK.attitude(np.zeros(1))[0])) + wrong_heading)
    runs = [
        filter_walk(recording, stances.mask, rows, start, replace(parameters, smoothed=s), pseudo, START_SIGMA)
        for s in (False, True)
    ]
    return (*runs, rows, start)


def dense_step(turn, push, h):
    F = np.eye(SIZE)
    propagate_columns(F, SIZE, turn, push, h)
    return F


def tape_of(monkeypatch, *arguments):
    """What the way back is given of a pass: its arguments, path and tape as the filter left them."""
    seen = []
    monkeypatch.setattr(core, "smooth_backward", lambda *given: seen.append(given))
    both(*arguments)
    monkeypatch.undo()
    return seen[0]


def rows_of(i, stands, rows, tape, stood):
    """The corrections at a sample as (h, s, nu), in their order."""
    found = []
    if stands[i]:
        found += [(np.eye(SIZE)[VELOCITY + a], t[VARIANCE], t[INNOVATION]) for a, t in enumerate(tape.stance[stood])]
    for k in np.flatnonzero(rows == i):
        found += [(t[ROW:], t[VARIANCE], t[INNOVATION]) for t in tape.footfall[k] if t[VARIANCE] > 0.0]
    return found


def dense_smoother(P, first, samples, stands, rows, noise, gravity, track, tape):
    """Errors (N, 15) left in the filter's states and their covariances, by a gain with an inverse at each step.

    `P` at the start. Only the path, and h, s, nu of the corrections are the filter's.
    """
    h, acc, gyr, acc_doubt, gyr_doubt = samples
    turn, push, stood = np.empty((3, 3)), np.empty(3), 0
    steps = []  # covariance before the corrections of a sample, what they took off, covariance after, F of the step
    for i in range(first, len(h)):
        before, taken = P.copy(), np.zeros(SIZE)
        for row, s, nu in rows_of(i, stands, rows, tape, stood):
            gain = P @ row / s
            taken += gain * nu
            P = P - np.outer(gain, gain) * s
        stood += stands[i]
        bias = tape.bias[i].copy()
        state = NavState(np.zeros(3), np.zeros(3), track.nav_R_body[i].copy(), bias[:3], bias[3:])
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
        F = dense_step(turn, push, h[i])
        steps.append((before, taken, P, F))
        P = F @ P @ F.T + np.diag(np.repeat([0.0, *compute_densities(noise, gyr[i], push, h[i], gravity)], 3) * h[i])
        P[3:6, 3:6] += turn @ np.diag(acc_doubt[i] ** 2) @ turn.T
        P[6:9, 6:9] += turn @ np.diag(gyr_doubt[i] ** 2) @ turn.T
    error, covariance = np.zeros((len(h), SIZE)), np.zeros((len(h), SIZE, SIZE))
    covariance[-1] = steps[-1][2]
    for i in range(len(h) - 2, first - 1, -1):
        _, _, P, F = steps[i - first]
        predicted, taken, _, _ = steps[i + 1 - first]
        gain = np.linalg.solve(predicted, F @ P).T
        error[i] = gain @ (error[i + 1] + taken)
        covariance[i] = P + gain @ (covariance[i + 1] - predicted) @ gain.T
    return error, covariance


def difference(filtered, smoothed):
    """What the smoother took off the filter's position, velocity and attitude, (N, 9)."""
    turn = Rotation.from_matrix(filtered.nav_R_body @ np.swapaxes(smoothed.nav_R_body, 1, 2)).as_rotvec()
    return np.hstack([filtered.position - smoothed.position, filtered.velocity - smoothed.velocity, turn])


@pytest.mark.parametrize("gap", [None, 110])
def test_a_dense_smoother_that_inverts_agrees(monkeypatch, gap):
    p = replace(IezParameters(), acc_density=0.05, gyr_density_deg=0.1)
    given = (*noisy(5, 50.0, gap), np.radians(6.0), p)
    filtered, smoothed, rows, start = both(*given)
    _, P = make_initial_state(start, p, START_SIGMA)
    error, covariance = dense_smoother(P, *tape_of(monkeypatch, *given))
    assert np.abs(error[:, :9]).max() > 0.02
    np.testing.assert_allclose(difference(filtered, smoothed), error[:, :9], atol=1e-9)
    np.testing.assert_allclose(filtered.gyro_bias - smoothed.gyro_bias, error[rows, 9:12], atol=1e-9)
    sigma = np.sqrt(np.diagonal(covariance[rows], axis1=1, axis2=2))
    scaled = (smoothed.covariance - covariance[rows]) / (sigma[:, :, None] * sigma[:, None, :])
    assert np.abs(scaled).max() < 1e-6


def test_the_walk_ends_where_the_filter_ends_and_nowhere_is_it_less_sure():
    filtered, smoothed, rows, _ = both(*noisy(6), np.radians(4.0))
    for end in (-1, rows[-1]):  # nothing was measured after the last stance but standing still
        np.testing.assert_allclose(smoothed.position[end], filtered.position[end], atol=2e-3)
    assert np.array_equal(smoothed.position[-1], filtered.position[-1])
    assert np.array_equal(smoothed.nav_R_body[-1], filtered.nav_R_body[-1])
    before, after = (np.diagonal(t.covariance, axis1=1, axis2=2) for t in (filtered, smoothed))
    assert (after > 0.0).all()
    assert (after <= before * (1 + 1e-9)).all()
    assert (after[0, 6:9] < 0.5 * before[0, 6:9]).any()
    assert all(np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P)))).min() > 0 for P in smoothed.covariance)


def test_what_comes_before_the_first_stance_hangs_on_the_smoothed_start():
    _, smoothed, _, start = both(*noisy(8, since_s=SHORT_WALK.rest_s + 0.3), np.radians(8.0))
    assert start.row > 10
    about = slice(start.row - 10, start.row + 1)
    moved = np.diff(smoothed.position[about], axis=0) / 0.01
    assert np.abs(moved - smoothed.velocity[about][:-1]).max() < 0.1
    assert np.isfinite(smoothed.position).all()
