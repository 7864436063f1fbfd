"""Iron from an ordinary walk: against made-up walks whose iron, building and drift are known."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from fg_nav.calibration import UPPER, circular_sd_deg, correct_field, walk_model
from fg_nav.calibration import walk as walk_module
from fg_nav.calibration.walk import (
    WalkCalibrationParameters,
    calibrate_on_walk,
    find_iron,
    find_iron_sigma,
    measure_spread,
)
from fg_nav.calibration.walk_model import PHASES, StrideReadings, read_strides
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.simulation import Choices, simulate
from tests.magnetic.fields import footfalls, still

EARTH = np.array([0.0, 21.0, -43.0])
HARD = np.array([9.0, -6.0, 4.0])
ANYWAY = WalkCalibrationParameters(must_gain=False, largest_sigma_uT=np.inf)

STRIDE_SAMPLES, PERIOD_S, STRIDE_M = 22, 0.05, 1.3
CHOSEN = np.concatenate([[0], np.arange(5, 5 + PHASES - 1)])
"""Samples of a stride that are read: standing, then the swing."""

ALONG_M = STRIDE_M * np.clip((np.arange(STRIDE_SAMPLES) - 5) / (PHASES - 2), 0.0, 1.0)
PITCH_RAD = np.radians(45.0) * np.sin(2 * np.pi * ALONG_M / STRIDE_M)


def round_walk(strides=120, rounds=3):
    """Headings (F,) rad of right-angled rounds, a straight of which is several strides long."""
    return np.pi / 2 * np.floor(np.arange(strides) / strides * rounds * 4)


def make_motion(heading, rng):
    """True attitude (N, 3, 3) of a foot that swings, turned to these headings (S,) and standing flat to 1.5 deg."""
    tilt = np.radians(1.5) * rng.standard_normal((len(heading), 3)) * [1, 1, 0]
    turn = np.array([yaw_rotation(np.pi / 2 - angle) for angle in heading]) @ Rotation.from_rotvec(tilt).as_matrix()
    pitch = Rotation.from_rotvec(PITCH_RAD[:, None] * [0, 1, 0]).as_matrix()
    return (turn[:, None] @ pitch).reshape(-1, 3, 3)


def make_building(count, rng):
    """Field (count, PHASES, 3) of strides at new places: alike over a meter, heavy-tailed."""
    place = STRIDE_M * np.arange(count)[:, None] + ALONG_M[CHOSEN]
    alike = np.exp(-np.abs(np.diff(place.ravel())) / walk_model.FIELD_LENGTH_M)
    draw = rng.standard_t(6, (place.size, 3)) / np.sqrt(1.5)
    for i, share in enumerate(alike):
        draw[i + 1] = share * draw[i] + np.sqrt(1 - share**2) * draw[i + 1]
    return draw.reshape(count, PHASES, 3)


def walked(heading, seed, building_uT=8.0, hard=HARD, soft=None, drift_deg=0.0, again=0, delay_s=0.0, tilt_deg=0.0):
    """Strides with these headings.

    The inertial heading drifts evenly by `drift_deg` in all, and its tilt is wrong by `tilt_deg`, another each stride;
    with `again` the building repeats after so many strides.
    """
    rng, n = np.random.default_rng(seed), len(heading)
    truth, turn = make_motion(heading, rng), Rotation.from_rotvec
    cycle = np.arange(n) % (again or n)
    building = building_uT * make_building(again or n, rng)[cycle]
    sample = STRIDE_SAMPLES * np.arange(n)[:, None] + CHOSEN
    place = np.zeros((n, PHASES, 3))
    place[..., 0] = STRIDE_M * cycle[:, None] + ALONG_M[CHOSEN]
    rate = Rotation.from_matrix(np.swapaxes(truth[:-1], 1, 2) @ truth[1:]).as_rotvec() / PERIOD_S
    rate = np.append(rate, rate[-1:], axis=0)
    late = turn(-delay_s * rate[sample - 1].reshape(-1, 3)).as_matrix().reshape(n, PHASES, 3, 3)
    free = np.einsum("kpji,kpj->kpi", truth[sample] @ late, EARTH + building)
    reading = free @ (np.eye(3) if soft is None else soft) + hard
    drift = np.radians(np.linspace(0.0, drift_deg, n))[:, None] * [0, 0, -1]
    wrong = np.radians(tilt_deg) * rng.standard_normal((n, 3)) * [1, 1, 0]
    attitude = np.repeat((turn(wrong) * turn(-drift)).as_matrix(), STRIDE_SAMPLES, axis=0) @ truth
    return StrideReadings(PERIOD_S * np.arange(len(truth)), attitude, rate, sample, reading, place)


def test_without_a_building_the_iron_is_found_to_a_hair():
    soft = np.array([[1.05, 0.03, 0.0], [0.03, 0.96, 0.0], [0.0, 0.0, 1.0]])
    heading = np.linspace(0, 6 * np.pi, 120)
    walk = walked(heading, 2, building_uT=0.02, soft=soft)
    found = calibrate_on_walk(walk)
    np.testing.assert_allclose(found.hard_iron_uT, HARD, atol=0.1)
    bent = np.linalg.inv(found.correction)
    assert bent[0, 1] == pytest.approx(0.03, abs=0.003)
    assert bent[0, 0] / bent[1, 1] == pytest.approx(1.05 / 0.96, abs=0.005)
    model = walk_model.StrideModel.of(walk)
    spread = measure_spread(model, walk_model.fit_iron(model))
    assert spread.before_deg > 15
    assert spread.after_deg < 1


def test_a_tilt_that_is_not_exact_is_not_taken_for_vertical_iron():
    """A foot that stands flat shows the vertical iron by its tilt alone, and errors of the tilt look like all of it."""
    for tilt_deg, seed in product((0.1, 0.5), range(5)):
        found = calibrate_on_walk(walked(round_walk(), seed, building_uT=0.1, tilt_deg=tilt_deg))
        assert np.abs(found.hard_iron_uT - HARD).max() < 0.8
        assert (np.abs(found.hard_iron_uT - HARD) < 3.5 * found.sigma[:3]).all()


def test_a_level_circle_in_a_homogeneous_field_shows_all_of_the_iron():
    walk = simulate("calibration-loop", 3, Choices(rate_hz=200.0))
    drawn = walk.drawn["sensor"]
    recording = walk.recording.slice(0, len(walk.recording) // 2)
    found = calibrate_on_walk(read_strides(recording, detect_stances(recording)))
    np.testing.assert_allclose(found.hard_iron_uT, drawn["hard_iron_uT"], atol=0.3)
    soft = polar(np.linalg.inv(drawn["soft_iron"]))[1]
    assert np.abs((found.correction - soft)[UPPER] / found.sigma[3:]).max() < 3
    assert found.sigma[:3].max() < 0.3


@pytest.mark.parametrize("again", [0, 30], ids=["new places", "the same places four times"])
def test_errors_are_as_large_as_they_are_said_to_be(again):
    heading = round_walk(120, 8)
    errors = []
    for seed in range(16):
        found = calibrate_on_walk(walked(heading, seed, again=again), ANYWAY)
        errors.append((found.hard_iron_uT - HARD) / found.sigma[:3])
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_neither_late_readings_nor_a_drifting_heading_are_taken_for_iron():
    late, prompt = (
        calibrate_on_walk(walked(round_walk(), 4, building_uT=0.5, delay_s=delay_s)) for delay_s in (0.02, 0.0)
    )
    np.testing.assert_allclose(late.hard_iron_uT, prompt.hard_iron_uT, atol=0.5)
    steady, drifting = (calibrate_on_walk(walked(round_walk(), 5, drift_deg=drift)) for drift in (0.0, 25.0))
    np.testing.assert_allclose(drifting.hard_iron_uT[:2], steady.hard_iron_uT[:2], atol=0.7)


def test_what_a_straight_walk_and_the_same_places_again_do_not_show_is_in_the_sigma(monkeypatch):
    """Iron along the axis about which the foot pitches; four times round shows about as much of it as once.

    What is the same each time is the building's share of the residual, beyond the error of a reading.
    """
    straight = calibrate_on_walk(walked(np.zeros(120), 4), ANYWAY)
    assert straight.sigma[1] > 3 * straight.sigma[[0, 2]].max()
    new, same = (walk_model.StrideModel.of(walked(round_walk(120, 8), 3, again=again)) for again in (0, 30))
    variance = [walk_model.fit_iron(model).covariance[1, 1] for model in (new, same)]
    assert variance[1] > 1.3**2 * variance[0]
    square = np.mean(walk_model.fit_iron(same).linearization.residual ** 2)
    by_share = []
    for share in (0.0, 0.5, 1.0):
        monkeypatch.setattr(walk_model, "READING_UT", np.sqrt((1.0 - share) * square))
        by_share.append(walk_model.fit_iron(same).covariance[1, 1])
    none, half, whole = by_share
    assert whole > 3 * none
    assert (half - none) / (whole - none) == pytest.approx(0.45, abs=0.06)  # and fields absorbed, which are fewer


def test_a_short_walk_is_refused():
    walk = walked(round_walk(30), 10)
    for strides in (0, 1, 19):
        few = replace(walk, **{name: getattr(walk, name)[:strides] for name in ("sample", "reading", "place")})
        for find in (calibrate_on_walk, find_iron):
            with pytest.raises(CalibrationError, match=f"^{strides} strides? with a field cannot tell"):
                find(few)


def refusal(field):
    """In words; nothing if it is calibrated."""
    try:
        calibrate_on_walk(field)
    except CalibrationError as error:
        return str(error)
    return ""


def test_walks_without_iron_iron_in_one_part_only_and_iron_as_no_shoe_has_it_are_refused():
    bare = [walked(round_walk(), seed, hard=np.zeros(3)) for seed in range(16)]
    assert sum("no iron shows against the building" in refusal(walk) for walk in bare) >= 13
    # what stood beside the way in the middle of the walk, at one heading, is not on the shoe
    for walk in bare[:6]:
        there = (np.arange(120) >= 50) & (np.arange(120) < 65)
        beside = np.einsum("kpji,j->kpi", walk.nav_R_body[walk.sample], [35.0, 0.0, 0.0]) * there[:, None, None]
        assert refusal(replace(walk, reading=walk.reading + beside))
    bent = walked(round_walk(), 2, building_uT=0.02, soft=np.diag([2.5, 1.0, 1.0]))
    assert "as no shoe does" in refusal(bent)


@pytest.mark.parametrize("reading", [[20.0, 3.0, -40.0], [0.0, 0.0, 0.0]])
@pytest.mark.parametrize("noise_uT", [0.0, 0.3])
def test_a_magnetometer_that_does_not_feel_the_field_is_refused(reading, noise_uT):
    rng = np.random.default_rng(14)
    field = walked(round_walk(), rng)
    dead = replace(field, reading=np.array(reading) + noise_uT * rng.standard_normal(field.reading.shape))
    assert "does the magnetometer work" in refusal(dead)
    with pytest.raises(MagneticError, match=r"turn with the foot.*--no-mag"):
        find_iron(dead)
    for unit in (1e-6, 0.01, 1000.0):  # tesla, gauss, nanotesla
        assert refusal(replace(field, reading=unit * field.reading))


@pytest.mark.parametrize("heading", [round_walk(), np.zeros(120)], ids=["round", "straight"])
def test_the_iron_of_any_walk_is_found_to_within_its_sigma(heading):
    errors = []
    for seed in range(12):
        hard = HARD * (seed % 3 > 0)
        found = find_iron(walked(heading, seed, hard=hard))
        errors.append((found.hard_iron_uT - hard) / found.sigma[:3])
        assert not any("spreads by" in note for note in found.notes)
    assert np.sqrt(np.mean(np.square(errors))) < 1.4
    assert np.abs(errors).max() < 4.0
    corrected, of_h = correct_field(footfalls(still(30)), found), np.zeros((9, 9))
    sigma = find_iron_sigma(found, corrected)
    assert sigma.shape == (3,)
    assert (sigma > 0.0).all()
    of_h[:3, :3] = found.covariance[:3, :3]  # of h alone where soft iron is known
    np.testing.assert_allclose(find_iron_sigma(replace(found, covariance=of_h), corrected), found.sigma[:3])


def test_the_jacobian_is_that_of_the_residual():
    """Where the model holds: what is left over turns with the attitude too, which is not counted."""
    walk = walk_model.StrideModel.of(walked(round_walk(), 11, drift_deg=20.0))
    rng = np.random.default_rng(12)
    at = walk_model.start_unknowns(walk)
    scales = [9.0] * 3 + [0.1] * 6 + [9.0] * 3 + [0.01] + [1e-5] * 15 + [0.3] * (len(at) - walk_model.DRIFT)
    at += rng.standard_normal(len(at)) * scales
    fields, _ = walk_model.linearize(walk, at)
    R, _ = walk.strides.motion_before(at[walk_model.DELAY])
    common = walk_model.PHASE_SHARES @ at[walk_model.COMMON].reshape(-1, 3)
    left = np.einsum("kpji,kpj->kpi", R @ Rotation.from_rotvec(common).as_matrix(), fields)
    walk = replace(walk, strides=replace(walk.strides, reading=walk.strides.reading - left))
    step = 1e-6
    ahead, behind = (
        np.stack([walk_model.linearize(walk, at + sign * step * one)[0] for one in np.eye(len(at))], axis=3)
        for sign in (1, -1)
    )
    jacobian, difference = walk_model.linearize(walk, at)[1], -(ahead - behind) / (2 * step)
    np.testing.assert_allclose(jacobian, difference, atol=0.02, rtol=1e-3)


def test_the_gain_of_the_iron_is_that_of_blocks_left_out():
    """Chi squared of each block with iron and without, fitted to the other blocks: by least squares, one by one."""
    walk = walk_model.StrideModel.of(walked(round_walk(40), 16))
    fit = walk_model.fit_iron(walk)
    last, root = fit.linearization, np.linalg.cholesky(fit.prior + 1e-12 * np.eye(walk.unknowns)).T
    white = [walk_model.whiten(last.whitening, x) for x in (last.jacobian, last.residual)]
    A, r = (x * np.sqrt(last.weight).reshape(-1, *[1] * (x.ndim - 1)) for x in white)
    none, gain = walk_module.WITHOUT_IRON - fit.unknowns[:9], 0.0
    for block in walk_model.list_blocks(len(walk)):
        rows = np.vstack([np.delete(A, block, axis=0).reshape(-1, walk.unknowns), root])
        left = np.append(np.delete(r, block, axis=0).ravel(), root @ np.append(none, -fit.unknowns[9:]))
        found = np.linalg.lstsq(rows, left, rcond=None)[0]
        rest = np.linalg.lstsq(rows[:, 9:], left - rows[:, :9] @ none, rcond=None)[0]
        for sign, step in ((1, np.append(none, rest)), (-1, found)):
            gain += sign * ((r[block] - A[block] @ step) ** 2).sum()
    assert abs(gain) > 5.0
    assert walk_module._measure_gain(walk, fit) == pytest.approx(gain, rel=0.05)


def test_circular_spread_knows_no_edge():
    angle = np.radians(10) * np.random.default_rng(13).standard_normal(20_000)
    assert circular_sd_deg(angle + np.pi) == pytest.approx(10, rel=0.02)
    assert circular_sd_deg(np.append(angle, np.nan)) == pytest.approx(10, rel=0.02)
