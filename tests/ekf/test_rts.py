"""The way back over a pass: against a dense smoother that inverts, against truth, and for what it must not do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.rest import find_start
from fg_nav.ekf import core
from fg_nav.ekf.core import IezParameters, filter_walk, make_initial_state
from fg_nav.ekf.covariance import SIZE, VELOCITY, compute_densities, propagate_columns
from fg_nav.ekf.measurements import make_pseudo_measurements
from fg_nav.ekf.update import INNOVATION, ROW, VARIANCE
from fg_nav.estimators import estimate
from fg_nav.frames import compute_heading
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.walk import Options
from fg_nav.walk import Walk as PreparedWalk
from tests.ekf.motion import Walk

WALK = Walk(strides=4, rest_s=0.6, roll=0.3, height=0.06)
START_SIGMA = np.radians(5.0)


def noisy(seed, rate_hz=100.0, gap=None, since_s=0.0):
    """Recording with noise, a biased gyroscope, an eighth of a second missing; stances, and what footfalls measure."""
    rng = np.random.default_rng(seed)
    recording, stances = WALK.recording(rate_hz)
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
    attitude, k = WALK.attitude(recording.t[rows]), len(rows)
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
    start = find_start(recording, stances, float(compute_heading(WALK.attitude(np.zeros(1))[0])) + wrong_heading)
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
    _, smoothed, _, start = both(*noisy(8, since_s=WALK.rest_s + 0.3), np.radians(8.0))
    assert start.row > 10
    about = slice(start.row - 10, start.row + 1)
    moved = np.diff(smoothed.position[about], axis=0) / 0.01
    assert np.abs(moved - smoothed.velocity[about][:-1]).max() < 0.1
    assert np.isfinite(smoothed.position).all()


def test_the_solution_of_a_smoother_bears_its_name_and_says_so_in_its_parameters():
    recording, stances, _ = noisy(10)
    given = PreparedWalk(recording, stances, options=Options(preset="physical"))
    found = {name: estimate(given, name) for name in ("iez", "iez-rts")}
    assert found["iez-rts"].method == "iez-rts"
    assert [solution.parameters["smoothed"] for solution in found.values()] == [False, True]
    assert found["iez"].notes == found["iez-rts"].notes
    assert (found["iez-rts"].stances.heading_sigma <= found["iez"].stances.heading_sigma).all()
